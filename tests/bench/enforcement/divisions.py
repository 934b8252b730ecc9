"""The ways to divide the processors that are compared: what is written for each task in each context. Pure.

Shares under contexts come from the product's own Eq. 1, and realtime budgets from its Eq. 2 (`divide`), from one table
of weights. Shares become CPU weights in the kubelet's unit: one core is 1024.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from contextpolicy.planning.allocation.enforcement import fitted
from contextpolicy.planning.allocation.shares import Demand, divide
from tests.bench.enforcement.policy import ATTEMPTS, STEP, TABLE, WEIGHTED, Table
from tests.bench.enforcement.stories import PROCESSORS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tests.bench.enforcement.stories import Context, Story, Task

CORE = 1024
LEAST_SHARES = 2
REALTIME = 950
"""Thousandths of a period that the kernel leaves to realtime threads."""


@dataclass(frozen=True, slots=True)
class Setting:
    """What holds for one task: its weight, its limit and its realtime budget (thousandths), and where it may run.

    `slice` are the seconds that it asks the fair scheduler for at a time: a shorter one is served sooner. `after` are
    those from the beginning of the context until the limit is written.
    """

    shares: int = CORE
    quota: int | None = None
    budget: int = 0
    realtime: bool = False
    processors: frozenset[int] = frozenset(range(PROCESSORS))
    slice: float | None = None
    after: float = 0.0


DEFAULT, PRIORITY, TUNED, PINNED, ROUND_ROBIN = "default", "priority", "tuned", "pinned", "round robin"
LIMITS, WEIGHTS, BUDGETS, ALONE = "context limits", "context weights", "context realtime", "alone"
SUSPENSION = "context suspension"
STATIC = (DEFAULT, PRIORITY, TUNED, PINNED, ROUND_ROBIN)
CONTEXTUAL = (LIMITS, WEIGHTS, BUDGETS, SUSPENSION)
FIXED_PRIORITY = "slam"
"""The one task that has realtime priority throughout: the heaviest by priority of those that are critical somewhere."""


@dataclass(frozen=True, slots=True)
class Division:
    """One way, for a story and its tasks: a setting for each task in each context."""

    name: str
    settings: Mapping[str, Mapping[str, Setting]]

    @property
    def needs_realtime(self) -> bool:
        """Whether it gives any task realtime priority."""
        return any(one.realtime for settings in self.settings.values() for one in settings.values())


def division(name: str, story: Story, tasks: Sequence[Task], tuned: Mapping[str, int] | None = None) -> Division:
    """The division of that name; the tuned one is what the search found."""
    if name == TUNED:
        return static(name, story, weighted(tuned or {}))
    if name in _STATIC:
        return static(name, story, _STATIC[name](tasks))
    contextual = _CONTEXTUAL[name]
    return Division(name, {context.name: contextual(tasks, context) for context in story.contexts})


def static(name: str, story: Story, settings: Mapping[str, Setting]) -> Division:
    """The same in every context."""
    return Division(name, {context.name: settings for context in story.contexts})


def weighted(shares: Mapping[str, int]) -> dict[str, Setting]:
    """Nothing but a CPU weight for each task."""
    return {name: Setting(shares=amount) for name, amount in shares.items()}


def shares(tasks: Sequence[Task], context: Context, table: Table, ceiling: int | None = None) -> dict[str, int]:
    """Eq. 1: thousandths of a core."""
    total = PROCESSORS * 1000
    floors = table.floors([task for task in tasks if task.name not in context.suspends])
    claims = [
        Demand(
            task.name,
            table.weight(task, context),
            floors.get(task.name, STEP) // STEP,
            (STEP if task.name in context.suspends else ceiling or total) // STEP,
        )
        for task in tasks
    ]
    return {name: units * STEP for name, units in divide(total // STEP, claims).items()}


def kubelet_shares(millicores: int) -> int:
    """What the kubelet would write for a request."""
    return max(LEAST_SHARES, millicores * CORE // 1000)


def _default(tasks: Sequence[Task]) -> dict[str, Setting]:
    return {task.name: Setting() for task in tasks}


def _by_priority(tasks: Sequence[Task]) -> dict[str, Setting]:
    """Requests by priority and no limits: what a user of Kubernetes does first."""
    whole = sum(task.priority for task in tasks)
    return weighted({t.name: kubelet_shares(round(PROCESSORS * 1000 * t.priority / whole)) for t in tasks})


def _pinned(tasks: Sequence[Task]) -> dict[str, Setting]:
    """Each task on one processor, as a cpuset does; the largest first, to where less is wanted."""
    wanted = [0.0] * PROCESSORS
    settings = {}
    for task in sorted(tasks, key=lambda task: -task.wants):
        place = wanted.index(min(wanted))
        wanted[place] += task.wants
        settings[task.name] = Setting(processors=frozenset({place}))
    return settings


def _round_robin(tasks: Sequence[Task]) -> dict[str, Setting]:
    return _default(tasks) | {FIXED_PRIORITY: Setting(budget=REALTIME, realtime=True)}


def _limits(tasks: Sequence[Task], context: Context) -> dict[str, Setting]:
    """A quota from the share, at most a core: a task with one thread has no use for more."""
    return {name: Setting(quota=share) for name, share in shares(tasks, context, TABLE, ceiling=1000).items()}


def _weights(tasks: Sequence[Task], context: Context, table: Table = WEIGHTED) -> dict[str, Setting]:
    """A weight from the share, all cut alike to fit the processors; a suspended task has the least, and soon a quota.

    So much may a robot's policy weigh on a node that nobody else requests anything of. Beside other pods it is less,
    and the weights compare in the same way.
    """
    running = [task for task in tasks if task.name not in context.suspends]
    wanted = sum(task.wants for task in running) / PROCESSORS
    own = shares(tasks, context, table)
    raised = {task.name: max(own[task.name], table.least if task.protected else 0) for task in running}
    found = fitted(raised, table.floors(running), PROCESSORS * 1000)
    quota = STEP if table.freeze else None
    suspended = dict.fromkeys(context.suspends, Setting(LEAST_SHARES, quota=quota, after=table.grace))
    return {
        task.name: Setting(
            kubelet_shares(found[task.name]) if wanted > table.above else CORE,
            slice=table.slice if task.protected else None,
        )
        for task in running
    } | suspended


def _budgets(tasks: Sequence[Task], context: Context) -> dict[str, Setting]:
    """Eq. 2: a part of each processor's period at realtime priority; a suspended task leaves realtime."""
    running = [task for task in tasks if task.name not in context.suspends]
    claims = [Demand(task.name, TABLE.weight(task, context), STEP, REALTIME) for task in running]
    found = divide(REALTIME - STEP * len(context.suspends), claims)
    suspended = dict.fromkeys(context.suspends, Setting(LEAST_SHARES, quota=STEP, budget=STEP))
    return {name: Setting(budget=budget, realtime=True) for name, budget in found.items()} | suspended


def _suspension(tasks: Sequence[Task], context: Context) -> dict[str, Setting]:
    """A quota for what the context suspends; the others are left alone."""
    return _default(tasks) | dict.fromkeys(context.suspends, Setting(quota=STEP))


_STATIC = {
    DEFAULT: _default,
    ALONE: _default,
    PRIORITY: _by_priority,
    PINNED: _pinned,
    ROUND_ROBIN: _round_robin,
}
_CONTEXTUAL = {LIMITS: _limits, WEIGHTS: _weights, BUDGETS: _budgets, SUSPENSION: _suspension} | {
    name: partial(_weights, table=table) for name, table in ATTEMPTS.items()
}
