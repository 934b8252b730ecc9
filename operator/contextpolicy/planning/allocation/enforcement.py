"""How a share is enforced: the weight and the quota that it means for a container under each control. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.policy.spec import Control

if TYPE_CHECKING:
    from collections.abc import Iterable

    from contextpolicy.planning.allocation.placement import Container
    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.policy.spec import Task

PROTECTED_WEIGHT = 1000
"""The least weight of a protected task on a node in thousandths of a core, however little it needs: a task of small
weight waits long for its turn, and with 500 it still lost inputs. Measured by `make bench-enforcement`
(docs/decisions)."""


class Amounts(NamedTuple):
    """Thousandths of a core; None leaves what the container had before any policy. A weight of 0 is the least."""

    weight: int | None
    quota: int | None


def amounts(  # noqa: PLR0913 - all that a container's resources depend on
    control: Control, task: Task, share: int, *, suspended: bool, cap: int | None = None, containers: int = 1
) -> Amounts:
    """What a container of the task gets. A suspended one is capped under every control.

    `cap` is the task's `max` while a context changes it, `containers` how many the task has on the node: they divide
    both its cap and what a protected task weighs at least.
    """
    if control is Control.LIMIT:
        return Amounts(None, share)
    weighted = control is Control.WEIGHT
    if suspended:
        return Amounts(0 if weighted else None, task.suspended_cpu)
    least = PROTECTED_WEIGHT // containers if task.protected else 0
    most = task.max if cap is None else cap
    quota = None if most is None else max(most // containers, task.suspended_cpu)
    return Amounts(max(share, least) if weighted else None, quota)


def left_alone(control: Control, containers: Iterable[Container], plan: Plan) -> frozenset[str]:
    """The containers for which a share is only a figure: under Suspend an active task keeps what it has."""
    if control is not Control.SUSPEND:
        return frozenset()
    return frozenset(
        container.id
        for container in containers
        if container.node in plan.nodes and container.task not in plan.nodes[container.node].suspended
    )
