"""The status of a ContextPolicy: what is active, what each task gets, and what is wrong if something is. Pure."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from contextpolicy.actuators.order import request_factors
from contextpolicy.planning.conditions.stream import UNHEARD
from contextpolicy.policy.quantities import format_cpu
from contextpolicy.policy.spec import Mode, Scheduler

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from contextpolicy.cluster.claims import Claim
    from contextpolicy.planning.allocation.plan import Plan, TaskPlan
    from contextpolicy.planning.conditions.stream import StreamState
    from contextpolicy.planning.planner import Planner

MAX_MESSAGE = 1024
NO_ROUTER = "no Zenoh router answers: no sample is heard, the last plan stays in force"
NEEDED = ("Accepted", "Connected", "Applied")
"""The conditions that `Ready` consists of. A sleeping microphone or a floor that does not fit are told, but they are no
failure of the policy."""
GIVE_UP = (
    "the policy is deleted once its containers are as they were; to give up, remove its finalizer "
    "contextpolicy.dev/restore, and they keep what they have"
)
MAX_NODES = 64
"""How many nodes the status lists: the definition's limit, so that the object stays small."""
_UNITS = (("years", 365.25 * 86400), ("days", 86400.0), ("h", 3600.0), ("s", 0.0))


@dataclass(frozen=True, slots=True)
class ConditionFinding:
    """One condition; without `problems` it is True with reason `good`, else False with reason `bad`."""

    type: str
    good: str
    bad: str
    problems: Sequence[str] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ShadowFacts:
    """How a shadow fares: `decided` is the other policy's plan, None while the shadow is promoted.

    `misses` are each task's before and since the promotion, None where unknown. `taken_back` is the last promotion that
    the operator undid, `is_back` whether this very version is back; `rival` is the shadow that is promoted instead.
    """

    promoted: bool
    decided: Plan | None
    misses: Mapping[str, tuple[float | None, float | None]]
    taken_back: Mapping[str, Any] | None
    is_back: bool = False
    rival: str = ""


@dataclass(frozen=True, slots=True)
class StatusFacts:
    """Everything the status is made from besides the planner's own state."""

    generation: int
    run: int
    claim: Claim
    connected: bool = True
    rejected: Sequence[str] = ()
    unmet_actuation: Mapping[str, str] = field(default_factory=dict)
    shadow: ShadowFacts | None = None
    promoted_shadow: str | None = None


def status(planner: Planner, facts: StatusFacts, previous: Sequence[Mapping[str, Any]], now: float) -> dict[str, Any]:
    """The whole status; `previous` are the current conditions, whose transition times are kept. `now` is Unix time."""
    plan, policy = planner.last, planner.policy
    contexts = list(plan.contexts) if plan else []
    bound = {container.task for container in facts.claim.placement.containers}
    return {
        "observedGeneration": facts.generation,
        "activeContexts": contexts,
        "contexts": ", ".join(contexts) or "-",
        "boundTasks": f"{len(bound)}/{len(policy.leaves)}",
        "promotedShadow": facts.promoted_shadow,
        "shadow": _shadow(planner, facts.shadow) if facts.shadow else None,
        "plan": _plan(planner, facts.run),
        "nodes": _nodes(planner, facts.claim)[:MAX_NODES],
        "moreNodes": max(0, len(plan.nodes if plan else ()) - MAX_NODES) or None,
        "tasks": [_task(planner, facts, task.name) for task in policy.tasks],
        "streams": _streams(planner),
        "conditions": conditions(_findings(planner, facts), facts.generation, previous, now),
    }


def waiting(
    rejected: Sequence[str], generation: int, previous: Sequence[Mapping[str, Any]], now: float, *, connected: bool
) -> dict[str, Any]:
    """The status of a policy without a runner: no version was ever valid, or the bus was never connected."""
    findings = [ConditionFinding("Accepted", "Valid", "Invalid", rejected), _connection(connected=connected)]
    return {"observedGeneration": generation, "conditions": conditions(findings, generation, previous, now)}


def releasing(
    problems: Iterable[str], generation: int, previous: Sequence[Mapping[str, Any]], now: float
) -> dict[str, Any]:
    """The status of a policy that is being deleted, while its containers are put back."""
    told = [f"{problem}; {GIVE_UP}" for problem in problems]
    finding = ConditionFinding("Applied", "Restored", "NotRestored", told)
    return {"observedGeneration": generation, "conditions": conditions([finding], generation, previous, now)}


def conditions(
    findings: Sequence[ConditionFinding], generation: int, previous: Sequence[Mapping[str, Any]], now: float
) -> list[dict[str, Any]]:
    """Kubernetes conditions, `Ready` first: it sums up whether the policy decides and its decisions are in force."""
    broken = [finding for finding in findings if finding.problems and finding.type in NEEDED]
    ready = ConditionFinding("Ready", "Working", "Degraded", [f"{f.type}: {f.problems[0]}" for f in broken])
    before = {condition["type"]: condition for condition in previous}
    return [_condition(finding, generation, before.get(finding.type), now) for finding in (ready, *findings)]


def _condition(
    finding: ConditionFinding, generation: int, before: Mapping[str, Any] | None, now: float
) -> dict[str, Any]:
    value = "False" if finding.problems else "True"
    since = before["lastTransitionTime"] if before and before.get("status") == value else timestamp(now)
    return {
        "type": finding.type,
        "status": value,
        "reason": finding.bad if finding.problems else finding.good,
        "message": "; ".join(finding.problems)[:MAX_MESSAGE],
        "observedGeneration": generation,
        "lastTransitionTime": since,
    }


def timestamp(moment: float) -> str:
    """RFC 3339 with whole seconds, as metav1.Time wants it."""
    return datetime.fromtimestamp(moment, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _findings(planner: Planner, facts: StatusFacts) -> list[ConditionFinding]:
    policy = planner.policy
    refused = [*facts.rejected, *facts.claim.conflicts]
    silent = [_silence(planner, name) for name, stream in planner.streams.items() if _is_silent(stream)]
    expressions = [f"{source}: {reason}" for source, reason in sorted(planner.errors.items())]
    shortfalls = (
        [f"{s.task}: {s.message}" if s.task else s.message for s in planner.last.shortfalls] if planner.last else []
    )
    unapplied = [*facts.claim.unlimited, *facts.claim.obstacles.values(), *facts.unmet_actuation.values()]
    realtime = [ConditionFinding("Realtime", "Scheduled", "Unavailable", facts.claim.realtime)]
    return [
        ConditionFinding("Accepted", "Valid", "Conflicted" if not facts.rejected else "Invalid", refused),
        _connection(connected=facts.connected),
        ConditionFinding(
            "StreamsHealthy", "Heard", "Silent" if silent else "ExpressionFailed", [*silent, *expressions]
        ),
        ConditionFinding("Feasible", "Met", "Unmet", shortfalls),
        _application(policy.mode, facts.shadow, unapplied),
        *(realtime if policy.enforcement.scheduler is Scheduler.REALTIME else ()),
    ]


def _application(mode: Mode, shadow: ShadowFacts | None, unapplied: Sequence[str]) -> ConditionFinding:
    """A shadow's containers are the other policy's: what keeps them from their shares is told there."""
    good = "InForce" if mode is Mode.ENFORCE else mode.value
    if shadow is None:
        return ConditionFinding("Applied", good, "NotApplied", unapplied if mode is Mode.ENFORCE else ())
    if shadow.is_back and shadow.taken_back is not None:
        told = f"the promotion was taken back at {shadow.taken_back['time']}: {shadow.taken_back['message']}"
        return ConditionFinding("Applied", good, "TakenBack", [f"{told}; edit the spec to try again"])
    rival = [f"{shadow.rival} is promoted already: only one shadow of a policy can be"] if shadow.rival else []
    return ConditionFinding("Applied", "Promoted" if shadow.promoted else good, "NotApplied", rival)


def _shadow(planner: Planner, facts: ShadowFacts) -> dict[str, Any]:
    named = {task: dict(zip(("missesBefore", "misses"), known, strict=True)) for task, known in facts.misses.items()}
    return {
        "difference": _difference(planner.last, facts.decided)[:MAX_MESSAGE],
        "tasks": [
            {"name": task, **{name: round(part, 4) for name, part in known.items() if part is not None}}
            for task, known in named.items()
        ],
        "takenBack": facts.taken_back,
    }


def _difference(plan: Plan | None, decided: Plan | None) -> str:
    """What the plan gives where the decided one gives something else."""
    had = decided.tasks if plan and decided else {}
    has = plan.tasks if plan and decided else {}
    return ", ".join(
        f"{name} {_given(had.get(name))} -> {_given(has.get(name))}"
        for name in sorted(had.keys() | has.keys())
        if _given(had.get(name)) != _given(has.get(name))
    )


def _given(task: TaskPlan | None) -> str:
    return "nothing" if task is None else format_cpu(task.share)


def _silence(planner: Planner, name: str) -> str:
    spec = planner.streams[name].spec
    heard = planner.streams[name].seen_at
    since = "no sample yet" if heard is None else f"last sample at {timestamp(heard)}"
    how = "is silent" if planner.streams[name].silent else f"had no sample for {UNHEARD / 3600:g} h"
    return f"stream {name} ({spec.key}) {how}: {since}"


def _is_silent(stream: StreamState) -> bool:
    return stream.silent or stream.unheard


def _connection(*, connected: bool) -> ConditionFinding:
    return ConditionFinding("Connected", "Open", "NoRouter", () if connected else (NO_ROUTER,))


def _plan(planner: Planner, run: int) -> dict[str, Any] | None:
    plan = planner.decided
    if plan is None:
        return None
    return {"run": run, "sequence": plan.sequence, "time": timestamp(plan.time), "cause": plan.cause[:MAX_MESSAGE]}


def _nodes(planner: Planner, claim: Claim) -> list[dict[str, Any]]:
    nodes = planner.last.nodes if planner.last else {}
    factors = request_factors(planner.policy, claim.placement.containers, nodes, claim.agents)
    return [
        {
            "name": name,
            "capacity": format_cpu(node.capacity),
            "allocatable": format_cpu(claim.placement.allocatable.get(name, 0)),
            "dividedBy": node.basis,
            **({"requestFactor": round(factors[name], 3)} if name in factors else {}),
            **({"message": claim.shared[name][:MAX_MESSAGE]} if name in claim.shared else {}),
        }
        for name, node in sorted(nodes.items())
    ]


def _task(planner: Planner, facts: StatusFacts, name: str) -> dict[str, Any]:
    plan = planner.last.tasks.get(name) if planner.last else None
    pods = sum(container.task == name for container in facts.claim.placement.containers)
    shortfalls = [s.message for s in planner.last.shortfalls if s.task == name] if planner.last else []
    problems = [*shortfalls, *([facts.claim.obstacles[name]] if name in facts.claim.obstacles else [])]
    warnings = [facts.claim.warnings[name]] if name in facts.claim.warnings else []
    because = [plan.because] if plan else []
    return {
        "name": name,
        "weight": plan.weight if plan else 0,
        "share": format_cpu(plan.share if plan else 0),
        "suspended": bool(plan and plan.suspended),
        "pods": pods,
        "message": "; ".join([*(problems or because), *warnings])[:MAX_MESSAGE],
    }


def _streams(planner: Planner) -> list[dict[str, Any]]:
    """Each stream's health, what waits for it, and how many of its samples were dropped."""
    waits: dict[str, dict[str, str]] = defaultdict(dict)
    for who, waiting_for in planner.waits():
        told = f"{who} has been waiting since {timestamp(waiting_for.since)}: {waiting_for.reason}"
        waits[waiting_for.stream].setdefault(who, told)
    return [_stream(planner, name, waits[name].values()) for name in planner.streams]


def _stream(planner: Planner, name: str, waits: Iterable[str]) -> dict[str, Any]:
    stream = planner.streams[name]
    dropped = [f"{reason}: {count}" for (of, reason), count in sorted(planner.drops.items()) if of == name]
    told = [_silence(planner, name)] if _is_silent(stream) else []
    told += [] if stream.clock.behind is None else [_other_clock(stream.clock.behind)]
    message = "; ".join([*told, *waits, *dropped])
    return {"name": name, "healthy": not _is_silent(stream), "message": message[:MAX_MESSAGE]}


def _other_clock(behind: float) -> str:
    unit, size = next((unit, size) for unit, size in _UNITS if abs(behind) >= size)
    off = f"{abs(behind) / (size or 1):.0f} {unit} {'behind' if behind > 0 else 'ahead of'} ours"
    return f"its timestamps are of another clock, {off} (simulated time, a replay?): the time of arrival counts"
