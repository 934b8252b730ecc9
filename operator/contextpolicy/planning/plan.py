"""The shares of all tasks at one instant, with the cause."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.policy.spec import Scheduler

if TYPE_CHECKING:
    from collections.abc import Mapping


class TaskPlan(NamedTuple):
    """One task: `share` is the sum over its containers in thousandths of a core (or of the realtime period)."""

    score: float
    weight: float
    share: int
    because: str

    @property
    def suspended(self) -> bool:
        """Whether the task's weight is 0; it then has the least share the kernel allows, not none."""
        return self.weight == 0


@dataclass(frozen=True, slots=True)
class NodePlan:
    """One node's division: `capacity` is N in thousandths of a core, or the realtime budget."""

    capacity: int
    shares: Mapping[str, int]
    containers: Mapping[str, int]
    scheduler: Scheduler = Scheduler.CFS


@dataclass(frozen=True, slots=True)
class Shortfall:
    """A constraint that the plan can't meet."""

    task: str
    message: str


@dataclass(frozen=True, slots=True)
class Plan:
    """What every task gets from `time` on, and why.

    `arrived` is when the sample that made it reached the operator, on the monotonic clock; None when a timer, an edit
    or a container that came or went made it.
    """

    sequence: int
    time: float
    cause: str
    contexts: tuple[str, ...]
    tasks: Mapping[str, TaskPlan]
    nodes: Mapping[str, NodePlan]
    shortfalls: tuple[Shortfall, ...]
    arrived: float | None = None

    @property
    def containers(self) -> dict[str, int]:
        """Each container's share, over all nodes."""
        return {identity: share for node in self.nodes.values() for identity, share in node.containers.items()}

    def changes(self, last: Plan | None) -> bool:
        """Whether it differs from `last` in what it does or says; time, cause and weights alone are no difference."""
        return last is None or _substance(self) != _substance(last)


def _substance(plan: Plan) -> tuple[object, ...]:
    suspended = frozenset(name for name, task in plan.tasks.items() if task.suspended)
    return plan.contexts, suspended, plan.nodes, plan.shortfalls
