"""What a policy will do to each task: plans, profiles and a timeline -> queues, response times, misses and idle CPU."""

from __future__ import annotations

import bisect
import math
from collections import Counter, defaultdict
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from contextpolicy.planning.allocation.enforcement import amounts
from contextpolicy.policy.bandwidth import PERIOD
from contextpolicy.policy.key_expressions import selects
from contextpolicy.policy.spec import Control, Scheduler
from contextpolicy.simulation.server import Allowance, Change, Fate, Server, Work, Worker

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.policy.spec import Policy
    from contextpolicy.simulation.profiles import Profiles, TaskProfile
    from contextpolicy.simulation.server import Outcome, Served
    from contextpolicy.streams.timeline import Timeline, TimelineEntry

REACTION = 0.03
"""Seconds from a plan to the cgroup: the median that `make bench-reaction` measures for a resize, rounded."""
PHASES = 4
"""Runs per prediction. It is unknown when the kernel's periods begin, seen from a sensor: a fresh quota in
the middle of an input can halve its time. So the periods begin at as many equally likely moments."""
ALL, NONE = "", "-"
"""The names under which the whole run and the time without any context are reported."""


@dataclass(frozen=True, slots=True)
class Stats:
    """What becomes of a task's inputs; times in seconds, None where undefined. Counts are rounded means.

    `missed` are done, but later than the deadline; `misses` are missed and dropped inputs, and those that wait past
    their deadline at the end, as a part of all that were due. Suspended inputs are not due.
    """

    inputs: int
    done: int
    missed: int
    dropped: int
    suspended: int
    unfinished: int
    misses: float
    worst: float
    """The misses in the least favourable phase of the kernel's periods."""
    p50: float | None
    p99: float | None
    queue: float
    """The mean number of inputs that an input found waiting."""


@dataclass(frozen=True, slots=True)
class Forecast:
    """Statistics by task and context, and idle cores by context; `ALL` is the whole run."""

    deadlines: Mapping[str, float | None]
    outcomes: Mapping[str, Sequence[Outcome]]
    tasks: Mapping[str, Mapping[str, Stats]]
    idle: Mapping[str, float]
    plans: float
    """Plans a second that change a share."""
    notes: tuple[str, ...] = ()


@dataclass(slots=True)
class _Node:
    cores: float
    tasks: dict[str, TaskProfile] = field(default_factory=dict)

    def workers(self) -> dict[str, Worker]:
        """New ones for a run."""
        return {
            name: Worker([cost.depth for cost in own.inputs], own.threads, own.background)
            for name, own in self.tasks.items()
        }


def forecast(  # noqa: PLR0913 - what a run consists of, by keyword
    policy: Policy,
    timeline: Timeline,
    plans: Sequence[Plan],
    profiles: Profiles,
    *,
    until: float,
    deadlines: Mapping[str, float] | None = None,
    reaction: float = REACTION,
) -> Forecast:
    """Predict a run whose plans are known.

    Of a task on several nodes, the first node counts. `deadlines` in seconds replace those of policy and profiles,
    `reaction` is seconds from a plan to the cgroup.
    """
    plans = [plan for plan in plans if plan.nodes]
    notes: list[str] = []
    nodes, homes = _nodes(plans, profiles), _homes(plans)
    arrivals = sorted(_arrivals(timeline, profiles, homes, until, notes))
    used: list[Served] = []
    outcomes: list[Outcome] = []
    fair = policy.enforcement.scheduler is Scheduler.CFS
    phases = 1 if fair and policy.enforcement.control is not Control.LIMIT else PHASES
    for name, node in nodes.items():
        changes = [_change(policy, plan, name, node.tasks, reaction) for plan in plans]
        own = [work for work in arrivals if homes[work.task] == name]
        for phase in range(phases):
            server = Server(node.cores, node.workers(), _period(policy), phase / phases * _period(policy))
            server.serve(own, changes, until)
            used += server.used
            outcomes += [one._replace(phase=phase) for one in server.outcomes]
    limits = _deadlines(policy, profiles, deadlines or {})
    by_task = {task: [one for one in outcomes if one.work.task == task] for task in homes if task in profiles.tasks}
    contexts = _Contexts(plans)
    tasks = {task: _by_context(own, contexts, limits[task]) for task, own in by_task.items()}
    idle = _idle(used, contexts, [node.cores for node in nodes.values()], phases)
    rate = len({plan.sequence for plan in plans}) / until if until else 0.0
    return Forecast(limits, by_task, tasks, idle, rate, (*notes, *_unknown(policy, profiles)))


def stats(outcomes: Iterable[Outcome], deadline: float | None) -> Stats:
    """Count outcomes, over all phases that they are of."""
    listed = list(outcomes)
    limit = math.inf if deadline is None else deadline
    by_phase = defaultdict(list)
    for one in listed:
        by_phase[one.phase].append(one)
    runs = max(len(by_phase), 1)
    counts = Counter(one.fate for one in listed)
    times = sorted(one.response for one in listed if one.fate is Fate.DONE)
    return Stats(
        inputs=round(len(listed) / runs),
        done=round(len(times) / runs),
        missed=round(sum(time > limit for time in times) / runs),
        dropped=round(counts[Fate.DROPPED] / runs),
        suspended=round(counts[Fate.SUSPENDED] / runs),
        unfinished=round(counts[Fate.UNFINISHED] / runs),
        misses=_misses(listed, limit),
        worst=max((_misses(own, limit) for own in by_phase.values()), default=0.0),
        p50=_quantile(times, 0.5),
        p99=_quantile(times, 0.99),
        queue=sum(one.queue for one in listed) / len(listed) if listed else 0.0,
    )


def _misses(outcomes: Iterable[Outcome], limit: float) -> float:
    """Late, dropped and overdue inputs, as a part of those that were due."""
    due = late = 0
    for one in outcomes:
        is_late = one.fate is Fate.DROPPED or (one.response > limit and one.fate in (Fate.DONE, Fate.UNFINISHED))
        late += is_late
        due += is_late or one.fate is Fate.DONE
    return late / due if due else 0.0


def _quantile(ascending: Sequence[float], part: float) -> float | None:
    return ascending[min(len(ascending) - 1, int(part * len(ascending)))] if ascending else None


class _Contexts:
    """Which contexts held when."""

    def __init__(self, plans: Sequence[Plan]) -> None:
        self._times = [plan.time for plan in plans]
        self._names = [plan.contexts or (NONE,) for plan in plans]

    def at(self, time: float) -> tuple[str, ...]:
        index = bisect.bisect_right(self._times, time) - 1
        return self._names[index] if index >= 0 else (NONE,)

    def spans(self, start: float, end: float) -> Iterator[tuple[float, tuple[str, ...]]]:
        """The parts of a stretch, in seconds, with the contexts of each."""
        cuts = [at for at in self._times[bisect.bisect_right(self._times, start) :] if at < end]
        for low, high in zip([start, *cuts], [*cuts, end], strict=True):
            yield high - low, self.at(low)


def _by_context(outcomes: Sequence[Outcome], contexts: _Contexts, deadline: float | None) -> dict[str, Stats]:
    sorted_ = defaultdict(list)
    for one in outcomes:
        for name in (ALL, *contexts.at(one.work.at)):
            sorted_[name].append(one)
    return {name: stats(own, deadline) for name, own in sorted_.items()}


def _idle(used: Iterable[Served], contexts: _Contexts, cores: Sequence[float], phases: int) -> dict[str, float]:
    """Mean idle cores, over all nodes, which have these `cores`."""
    busy: dict[str, float] = defaultdict(float)
    lasted: dict[str, float] = defaultdict(float)
    for stretch in used:
        for seconds, names in contexts.spans(stretch.start, stretch.end):
            for name in (ALL, *names):
                busy[name] += seconds * stretch.cores / phases
                lasted[name] += seconds / (phases * len(cores))
    return {name: sum(cores) - busy[name] / lasted[name] for name in lasted if lasted[name] > 0}


def _nodes(plans: Sequence[Plan], profiles: Profiles) -> dict[str, _Node]:
    """The nodes with the tasks that run there. What the policy divides is what there is: its reserve counts as used."""
    nodes: dict[str, _Node] = {}
    for task, home in _homes(plans).items():
        profile = profiles.tasks.get(task)
        first = next(plan.nodes[home] for plan in plans if home in plan.nodes)
        node = nodes.setdefault(home, _Node(first.capacity / 1000))
        if profile is not None:
            node.tasks[task] = profile
    return nodes


def _homes(plans: Sequence[Plan]) -> dict[str, str]:
    """The first node of each task that has a container."""
    homes: dict[str, str] = {}
    for plan in plans:
        for name, node in plan.nodes.items():
            for task in node.shares:
                homes.setdefault(task, name)
    return homes


def _period(policy: Policy) -> float:
    return policy.enforcement.period if policy.enforcement.scheduler is Scheduler.REALTIME else PERIOD


def _change(policy: Policy, plan: Plan, node: str, workers: Iterable[str], reaction: float) -> Change:
    """A plan's allowances, when the kernel has them; the first plan is in force from the start.

    A realtime budget is one of each processor, and modules have threads enough to use them all.
    """
    own = plan.nodes.get(node)
    allowances = {}
    for task in workers:
        share = own.containers.get(task, own.shares.get(task, 0)) / 1000 if own else 0.0
        cap = own.caps.get(task) if own else None
        allowances[task] = _allowance(policy, task, share, suspended=plan.tasks[task].suspended, cap=cap)
    return Change(plan.time + reaction if plan.time > 0 else 0.0, allowances)


def _allowance(policy: Policy, task: str, share: float, *, suspended: bool, cap: int | None) -> Allowance:
    """Where nothing weighs, tasks are equals; Realtime's budgets are quotas too."""
    own = policy.enforcement
    if own.scheduler is Scheduler.REALTIME:
        return Allowance(1.0, share, suspended)
    spec = next(one for one in policy.tasks if one.name == task)
    weight, quota = amounts(own.control, spec, round(share * 1000), suspended=suspended, cap=cap)
    return Allowance(
        1.0 if weight is None else max(weight, 1) / 1000, None if quota is None else quota / 1000, suspended
    )


def _arrivals(
    timeline: Timeline, profiles: Profiles, homes: Mapping[str, str], until: float, notes: list[str]
) -> Iterator[Work]:
    """Every input that a profiled task takes, with its work."""
    for task, profile in profiles.tasks.items():
        for index, cost in enumerate(profile.inputs if task in homes else ()):
            entries = [entry for entry in timeline.entries if selects(cost.key, entry.key)]
            times = sorted(at for entry in entries for at in _times(entry) if at < until)
            if not times:
                notes.append(f"the timeline has no input for {task} on {cost.key}, or gives no rate: not predicted")
            for number, at in enumerate(times):
                yield Work(at + cost.transit, task, index, cost.work(number), cost.transit)


def _times(entry: TimelineEntry) -> Iterator[float]:
    if entry.dataset is not None:
        entry = replace(entry, rate=entry.dataset_rate, dataset=None)
        if not entry.rate:
            return iter(())
    return (timed.at for timed in entry.inputs())


def _deadlines(policy: Policy, profiles: Profiles, given: Mapping[str, float]) -> dict[str, float | None]:
    """The deadlines given, else the policy's, else those of the modules' profiles."""
    said = {task.name: task.needs.deadline for task in policy.tasks if task.needs.deadline is not None} | dict(given)
    return {name: said.get(name, profile.deadline) for name, profile in profiles.tasks.items()}


def _unknown(policy: Policy, profiles: Profiles) -> Iterator[str]:
    for task in policy.leaves:
        if task.name not in profiles.tasks:
            yield f"there is no profile for {task.name}: it is predicted to use no CPU"
    for name in profiles.tasks:
        if name not in {task.name for task in policy.leaves}:
            yield f"the policy has no task {name}: its profile is not used"
