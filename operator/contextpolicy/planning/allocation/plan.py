"""The shares of all tasks at one instant, with the cause."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.policy.spec import Scheduler

if TYPE_CHECKING:
    from collections.abc import Mapping
    from collections.abc import Set as AbstractSet


class TaskPlan(NamedTuple):
    """One task: `share` is the sum over its containers, in thousandths of a core.

    A suspended task has the least share the kernel allows, not none. One that weighs 0 because nothing is active is
    not suspended while its node is divided by priority.
    """

    score: float
    weight: float
    share: int
    because: str
    suspended: bool = False


class Basis(StrEnum):
    """What a node is divided by: weight (Eq. 1, 2); priority while nothing is active; nothing if all is suspended."""

    WEIGHT = "Weight"
    PRIORITY = "Priority"
    NOTHING = "Nothing"


class NodePlan(NamedTuple):
    """One node's division of N, its `capacity`, into shares by task and by container, in thousandths of a core.

    Under Realtime all are multiples of the node's number of processors, each of which gives the same part of its
    period: N is at most 95 % of them. `suspended` are its suspended tasks, `caps` the `max` of those tasks whose own an
    active context changes.
    """

    capacity: int
    shares: Mapping[str, int]
    containers: Mapping[str, int]
    scheduler: Scheduler = Scheduler.CFS
    basis: Basis = Basis.WEIGHT
    suspended: AbstractSet[str] = frozenset()
    caps: Mapping[str, int] = {}


@dataclass(frozen=True, slots=True)
class Shortfall:
    """A constraint that the plan can't meet."""

    task: str
    message: str


@dataclass(frozen=True, slots=True)
class Plan:
    """What every task gets from `time` on, and why.

    Plans with one sequence number have the same shares: the first is carried out, later ones only update weights,
    scores and contexts, with the cause.

    `arrived` is when the sample that caused it reached the operator, in seconds on the monotonic clock; None when the
    cause is a timer, an edit, or a container that came or went.
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
        """Each container's share in thousandths of a core, over all nodes."""
        return {identity: share for node in self.nodes.values() for identity, share in node.containers.items()}

    def is_news_after(self, last: Plan | None) -> bool:
        """Whether it shows anything that `last` did not."""
        return last is None or (self.contexts, self.tasks) != (last.contexts, last.tasks)
