"""What the recording proves: reaction times, the limits of each context, and whether the policy was kept. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from timelines.demo.recorder import Recording

SETTLED = 1.0
"""Seconds: a plan in force for at least this long must be in the cgroups when the next one comes."""


@dataclass(frozen=True, slots=True)
class Reaction:
    """A plan that moved limits: milliseconds from its trigger to each stage, None for a stage it never reached.

    `moved` has the shares that changed, in cores.
    """

    at: float
    cause: str
    contexts: tuple[str, ...]
    moved: Mapping[str, float]
    plan_ms: float
    patch_ms: float | None
    cgroup_ms: float | None


def reactions(recording: Recording, started: float) -> list[Reaction]:
    """All plans that changed a share, with how long each stage took."""
    found = []
    before: dict[str, float] = {}
    for plan, until in _spans(recording.plans):
        shares = {name: task["share"] for name, task in plan["tasks"].items()}
        changed = {name for name in shares if shares[name] != before.get(name)}
        before = shares
        if changed and plan["trigger"] >= started:
            found.append(_reaction(recording, plan, until, started, changed))
    return found


def mismatches(recording: Recording, expected_contexts: set[str]) -> list[str]:
    """What went wrong: expected contexts that never held, plans that never reached the kernel."""
    seen = {context for plan in recording.plans for context in plan["contexts"]}
    problems = [f"context {name} never held" for name in sorted(expected_contexts - seen)]
    for plan, until in _spans(recording.plans):
        if until - plan["trigger"] < SETTLED:
            continue
        for task, planned in plan["tasks"].items():
            enforced = at(recording.limits.get(task, []), until)
            if enforced is None or abs(enforced - planned["share"]) > 1e-6:
                problems.append(
                    f"{plan['cause']}: {task} should have {planned['share']:g} cores, its cgroup has {enforced}"
                )
    if len({tuple(sorted((n, t["share"]) for n, t in plan["tasks"].items())) for plan in recording.plans}) < 2:
        problems.append("the shares never changed")
    return problems


def at(steps: Sequence[tuple[float, float]], moment: float) -> float | None:
    """The value that held at a moment; None before the first."""
    return next((value for since, value in reversed(steps) if since <= moment), None)


def spans(recording: Recording, started: float) -> list[tuple[str, float, float]]:
    """When each context held, in seconds of the timeline."""
    found = []
    for plan, until in _spans(recording.plans):
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


def _reaction(
    recording: Recording, plan: Mapping[str, Any], until: float, started: float, changed: set[str]
) -> Reaction:
    trigger = plan["trigger"]
    told = [s for s in recording.applied if s["stage"] == "accepted" and s["sequence"] == plan["sequence"]]
    patches = [s["time"] for s in told if s["time"] >= plan["time"]]
    limits = [_reached(recording, task, plan["tasks"][task]["share"], trigger, until) for task in changed]
    in_cgroup = max((moment for moment in limits if moment is not None), default=None)
    return Reaction(
        at=trigger - started,
        cause=plan["cause"],
        contexts=tuple(plan["contexts"]),
        moved={name: task["share"] for name, task in plan["tasks"].items() if name in changed},
        plan_ms=(plan["time"] - trigger) * 1000,
        patch_ms=(min(patches) - trigger) * 1000 if patches else None,
        cgroup_ms=(in_cgroup - trigger) * 1000 if in_cgroup and None not in limits else None,
    )


def _reached(recording: Recording, task: str, share: float, since: float, until: float) -> float | None:
    steps = recording.limits.get(task, [])
    return next((moment for moment, value in steps if since <= moment <= until and abs(value - share) < 1e-6), None)


def _spans(plans: Sequence[dict[str, Any]]) -> Iterator[tuple[dict[str, Any], float]]:
    """Each plan with the moment at which the next one came; later editions of a plan move no shares, so are skipped."""
    plans = [plan for plan in plans if plan.get("edition", 0) == 0]
    for index, plan in enumerate(plans):
        yield plan, plans[index + 1]["trigger"] if index + 1 < len(plans) else plan["trigger"] + 3600


def _joined(found: list[tuple[str, float, float]]) -> list[tuple[str, float, float]]:
    joined: dict[str, list[tuple[str, float, float]]] = {}
    for name, start, end in found:
        own = joined.setdefault(name, [])
        if own and own[-1][2] >= start:
            own[-1] = (name, own[-1][1], end)
        else:
            own.append((name, start, end))
    return [span for own in joined.values() for span in own]
