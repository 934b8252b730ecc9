"""How a share is enforced: the weight and the quota that it means for a container under each control. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.policy.spec import Control

if TYPE_CHECKING:
    from contextpolicy.policy.spec import Task

PROTECTED_WEIGHT = 300
"""The least weight of a protected task in thousandths of a core, however little it needs: a task of small weight waits
long for its turn. Measured by `make bench-enforcement` (docs/decisions)."""


class Amounts(NamedTuple):
    """Thousandths of a core; None leaves what the container had before any policy. A weight of 0 is the least."""

    weight: int | None
    quota: int | None


def amounts(control: Control, task: Task, share: int, *, suspended: bool) -> Amounts:
    """What a container of the task gets. A suspended one is capped under every control."""
    if control is Control.LIMIT:
        return Amounts(None, share)
    weighted = control is Control.WEIGHT
    if suspended:
        return Amounts(0 if weighted else None, task.suspended_cpu)
    least = PROTECTED_WEIGHT if task.protected else 0
    return Amounts(max(share, least) if weighted else None, task.max)
