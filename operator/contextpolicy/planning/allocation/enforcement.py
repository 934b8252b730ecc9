"""How a share is enforced: the weight and the quota that it means for a container under each control. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeVar

from contextpolicy.planning.allocation.placement import QUANTUM
from contextpolicy.policy.spec import Control

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from contextpolicy.planning.allocation.placement import Container
    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.policy.spec import Task

Name = TypeVar("Name")
PROTECTED_WEIGHT = 1000
"""The least weight of a protected task on a node in thousandths of a core, however little it needs: a task of small
weight waits long for its turn, and with 500 it still lost inputs. Measured by `make bench-enforcement`
(docs/decisions). It is this beside the policy's other tasks: `fitted` may cut all of them alike."""


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


def kept_weight(task: Task, share: int, containers: int) -> int:
    """What a container's weight is not cut below: a protected task gets at least its `min`, where it is contested."""
    return max(1, min(share, task.min // containers if task.protected else QUANTUM))


def fitted(wanted: Mapping[Name, int], kept: Mapping[Name, int], most: int) -> dict[Name, int]:
    """The weights of one node's containers that run, which add up to `most` at most; all are cut by one factor.

    So they compare as wanted: a scheduler of weights knows no other measure. None is cut below what is `kept` for it,
    which is at most what is wanted, unless even that does not fit: then this is cut. None becomes 0, which suspends.
    """
    if sum(wanted.values()) <= most:
        return dict(wanted)
    if sum(kept.values()) >= most:
        return {name: max(1, amount) for name, amount in _cut(kept, most).items()}
    fixed: dict[Name, int] = {}
    while True:
        rest = {name: amount for name, amount in wanted.items() if name not in fixed}
        cut = _cut(rest, most - sum(fixed.values()))
        low = {name: kept[name] for name, amount in cut.items() if amount < kept[name]}
        if not low:
            return fixed | cut
        fixed |= low


def _cut(weights: Mapping[Name, int], most: int) -> dict[Name, int]:
    total = sum(weights.values())
    return {name: weight * most // total for name, weight in weights.items()}


def left_alone(control: Control, containers: Iterable[Container], plan: Plan) -> frozenset[str]:
    """The containers for which a share is only a figure: under Suspend an active task keeps what it has."""
    if control is not Control.SUSPEND:
        return frozenset()
    return frozenset(
        container.id
        for container in containers
        if container.node in plan.nodes and container.task not in plan.nodes[container.node].suspended
    )
