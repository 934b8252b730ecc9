"""What the recording proves: reaction times, and whether kernel and API matched each plan. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from statistics import median
from typing import TYPE_CHECKING, Any, NamedTuple

from contextpolicy.agent import weight_units
from contextpolicy.planning.allocation.enforcement import PROTECTED_WEIGHT
from timelines.demo.deploy import SETTLE

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from timelines.demo.recorder import Recording

SETTLED = 1.0
"""Seconds: a plan in force for at least this long must be in the cgroups when the next one comes."""
PATCHED = SETTLE + 2.0
"""Seconds: one in force for this long must be in the API too, where only what lasts arrives if an agent writes."""
RESTORED = 0.5
"""Seconds within which the agent restores a pod's weight that the kubelet overwrote, as it does with each resize."""
ROUNDING = 0.01
"""Part of a weight that is lost between the policy's status, the API's millicores and the kernel's unit."""


@dataclass(frozen=True, slots=True)
class Conversion:
    """How a plan's weights arrive in pods' cgroups.

    `factor` makes requests of them where no agent writes them; `beside` are the requests of a pod's other containers,
    in thousandths of a core; `version` is that of the cgroup hierarchy. A target's weight is what an agent writes,
    which is cut to what all other pods leave. Requests are made of the weights before that, for which the `protected`
    tasks count; it is None where an agent writes.
    """

    version: int
    factor: float = 1.0
    beside: Mapping[str, int] | None = None
    protected: Collection[str] | None = None

    def weight(self, target: Mapping[str, Any]) -> int:
        """The weight of the pod of a plan's target."""
        own = int(self._millicores(target) * self.factor)
        return weight_units.of_pod(own + (self.beside or {}).get(target["task"], 0), self.version)

    def _millicores(self, target: Mapping[str, Any]) -> int:
        weight, share = float(target["weight"]), float(target["cores"])
        if self.protected is None or not weight:
            return round(weight * 1000)
        return max(round(share * 1000), PROTECTED_WEIGHT if target["task"] in self.protected else 0)


class Wanted(NamedTuple):
    """What a plan wants of the kernel for a task: the pod's weight and the quota in cores; None is not moved."""

    weight: int | None
    quota: float | None


@dataclass(frozen=True, slots=True)
class Reaction:
    """A plan that moved what the kernel has: milliseconds from its trigger to each stage, None for one never reached.

    `moved` has the shares of the tasks that it moved, in cores.
    """

    at: float
    cause: str
    contexts: tuple[str, ...]
    moved: Mapping[str, float]
    plan_ms: float
    patch_ms: float | None
    cgroup_ms: float | None


def reactions(recording: Recording, started: float, conversion: Conversion) -> list[Reaction]:
    """All plans that moved a weight or a quota, with how long each stage took."""
    found = []
    before: dict[str, Wanted] = {}
    for plan, until in _spans(recording):
        wanted = _wanted(plan, conversion)
        changed = {task: own for task, own in wanted.items() if own != before.get(task)}
        before = wanted
        if changed and plan["trigger"] >= started:
            found.append(_reaction(recording, plan, until, started, changed))
    return found


def mismatches(recording: Recording, expected_contexts: set[str], conversion: Conversion) -> list[str]:
    """What went wrong: expected contexts that never held, plans that never reached the kernel or the API."""
    seen = {context for plan in recording.plans for context in plan["contexts"]}
    problems = [f"context {name} never held" for name in sorted(expected_contexts - seen)]
    for plan, until in _spans(recording):
        for task, wanted in _wanted(plan, conversion).items():
            problems += [
                f"{plan['cause']}: {task} {problem}"
                for problem in _differences(recording, task, wanted, until, until - plan["trigger"])
            ]
    if len({tuple(sorted((n, t["share"]) for n, t in plan["tasks"].items())) for plan in recording.plans}) < 2:
        problems.append("the shares never changed")
    return problems


def patches(recording: Recording, started: float) -> list[tuple[float, str, float, float]]:
    """Each limit that was patched through the API: seconds of the timeline, task, cores before and after."""
    return sorted(
        (moment - started, task, before, after)
        for task, steps in recording.patched.items()
        for (_, before), (moment, after) in pairwise(steps)
        if moment >= started
    )


def at(steps: Sequence[tuple[float, float]], moment: float) -> float | None:
    """The value that held at a moment; None before the first."""
    return next((value for since, value in reversed(steps) if since <= moment), None)


def spans(recording: Recording, started: float) -> list[tuple[str, float, float]]:
    """When each context held, in seconds of the timeline."""
    found = []
    for plan, until in _spans(recording):
        found += [(name, plan["trigger"] - started, until - started) for name in plan["contexts"]]
    return _joined(found)


def medians(found: Sequence[Reaction]) -> dict[str, float]:
    """The median time of each stage, in milliseconds."""
    stages = {
        "sample to plan": [r.plan_ms for r in found],
        "sample to patch": [r.patch_ms for r in found if r.patch_ms is not None],
        "sample to cgroup": [r.cgroup_ms for r in found if r.cgroup_ms is not None],
    }
    return {name: median(times) for name, times in stages.items() if times}


def _wanted(plan: Mapping[str, Any], conversion: Conversion) -> dict[str, Wanted]:
    return {
        one["task"]: Wanted(None if one["weight"] is None else conversion.weight(one), one["quota"])
        for one in plan.get("targets", ())
    }


def _differences(recording: Recording, task: str, wanted: Wanted, until: float, lasted: float) -> Iterator[str]:
    if lasted < SETTLED:
        return
    weights, quota = recording.weights.get(task, []), at(recording.limits.get(task, []), until)
    if wanted.weight is not None and not any(_weighs(one, wanted.weight) for one in _lately(weights, until)):
        yield f"should weigh {wanted.weight}, its pod's cgroup has {at(weights, until)}"
    if wanted.quota is not None and not _same(quota, wanted.quota):
        yield f"should have a quota of {wanted.quota:g} cores, its cgroup has {quota}"
    patched = at(recording.patched.get(task, []), until)
    if wanted.quota is not None and lasted >= PATCHED and not _same(patched, wanted.quota):
        yield f"should have a limit of {wanted.quota:g} cores, the API has {patched}"


def _lately(steps: Sequence[tuple[float, int]], until: float) -> list[float | None]:
    """The values that held at some moment of the last RESTORED seconds."""
    return [at(steps, until - RESTORED), *(value for since, value in steps if until - RESTORED < since <= until)]


def _same(value: float | None, wanted: float) -> bool:
    return value is not None and abs(value - wanted) < 1e-6


def _weighs(weight: float | None, wanted: int) -> bool:
    return weight is not None and abs(weight - wanted) <= max(2, ROUNDING * wanted)


def _reaction(
    recording: Recording, plan: Mapping[str, Any], until: float, started: float, changed: Mapping[str, Wanted]
) -> Reaction:
    trigger = plan["trigger"]
    steps = [s for s in recording.applied if s["stage"] == "accepted" and s["sequence"] == plan["sequence"]]
    sent = [s["time"] for s in steps if s["time"] >= plan["time"]]
    reached = [_reached(recording, task, wanted, trigger, until) for task, wanted in changed.items()]
    in_cgroup = max((moment for moment in reached if moment is not None), default=None)
    return Reaction(
        at=trigger - started,
        cause=plan["cause"],
        contexts=tuple(plan["contexts"]),
        moved={name: task["share"] for name, task in plan["tasks"].items() if name in changed},
        plan_ms=(plan["time"] - trigger) * 1000,
        patch_ms=(min(sent) - trigger) * 1000 if sent else None,
        cgroup_ms=(in_cgroup - trigger) * 1000 if in_cgroup and None not in reached else None,
    )


def _reached(recording: Recording, task: str, wanted: Wanted, since: float, until: float) -> float | None:
    """When the kernel had the weight, or the quota where none is wanted; None if never in that time."""
    steps: Sequence[tuple[float, float]] = recording.limits.get(task, [])
    if wanted.weight is not None:
        steps = recording.weights.get(task, [])

    def right(value: float) -> bool:
        return _same(value, wanted.quota or 0) if wanted.weight is None else _weighs(value, wanted.weight)

    before = at(steps, since)
    if before is not None and right(before):
        return since  # it differs by less than the kernel's rounding
    return next((moment for moment, value in steps if since <= moment <= until and right(value)), None)


def _spans(recording: Recording) -> Iterator[tuple[dict[str, Any], float]]:
    """Each plan with when the next one came or the recording ended; later editions of a plan move nothing."""
    plans = [plan for plan in recording.plans if plan.get("edition", 0) == 0]
    ends = [*(plan["trigger"] for plan in plans[1:]), recording.ended]
    yield from zip(plans, ends, strict=False)


def _joined(found: list[tuple[str, float, float]]) -> list[tuple[str, float, float]]:
    joined: dict[str, list[tuple[str, float, float]]] = {}
    for name, start, end in found:
        own = joined.setdefault(name, [])
        if own and own[-1][2] >= start:
            own[-1] = (name, own[-1][1], end)
        else:
            own.append((name, start, end))
    return [span for own in joined.values() for span in own]
