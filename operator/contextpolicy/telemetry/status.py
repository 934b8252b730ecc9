"""The status of a ContextPolicy: what is active, what each task gets, and what is wrong if something is. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from contextpolicy.actuators.order import request_factors
from contextpolicy.planning.restart import Remembered
from contextpolicy.policy.custom_resource import FINALIZER
from contextpolicy.policy.quantities import format_cpu
from contextpolicy.policy.spec import Mode, Scheduler
from contextpolicy.telemetry.api_text import MAX_MESSAGE, timestamp
from contextpolicy.telemetry.stream_status import silences, stream_status

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from contextpolicy.cluster.claims import Claim
    from contextpolicy.planning.allocation.plan import Plan, TaskPlan
    from contextpolicy.planning.planner import Planner
    from contextpolicy.policy.spec import Policy

NO_ROUTER = "no Zenoh router answers: no samples arrive, and the last plan stays in force"
NEEDED = ("Accepted", "Connected", "Bound", "Applied")
"""The conditions that `Ready` consists of. A sleeping microphone or a floor that does not fit are reported, but are no
failure of the policy."""
GIVE_UP = (
    "the policy is deleted once its containers are restored; to delete it without restoring them, remove its finalizer "
    f"{FINALIZER}"
)
MAX_NODES = 64
"""How many nodes the status lists: the definition's limit, so that the object stays small."""


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

    `misses` are each task's before and since the promotion, None where unknown. `reverted` is the last promotion that
    the operator undid, `is_reverted` whether it was of this very version; `rival` is the shadow promoted instead.
    """

    promoted: bool
    decided: Plan | None
    misses: Mapping[str, tuple[float | None, float | None]]
    reverted: Mapping[str, Any] | None
    is_reverted: bool = False
    rival: str = ""


@dataclass(frozen=True, slots=True)
class StatusFacts:
    """Everything the status is made from besides the planner's own state.

    The planner's time is `ahead` seconds of the wall clock, which can be set: a status has times of the latter.
    """

    generation: int
    run: int
    claim: Claim
    ahead: float = 0.0
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
        "plan": _plan(planner, facts),
        "nodes": _nodes(planner, facts.claim)[:MAX_NODES],
        "moreNodes": max(0, len(plan.nodes if plan else ()) - MAX_NODES) or None,
        "tasks": [_task(planner, facts, task.name) for task in policy.tasks],
        "streams": stream_status(planner, facts.ahead),
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
    """The status of a policy that is being deleted, while its containers are restored."""
    unrestored = [f"{problem}; {GIVE_UP}" for problem in problems]
    finding = ConditionFinding("Applied", "Restored", "NotRestored", unrestored)
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


def _findings(planner: Planner, facts: StatusFacts) -> list[ConditionFinding]:
    policy = planner.policy
    refused = [*facts.rejected, *facts.claim.conflicts]
    silent = silences(planner, facts.ahead)
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
        ConditionFinding("Bound", "Found", "Missing", _unbound(policy, facts.claim)),
        _application(policy.mode, facts.shadow, unapplied),
        *(realtime if policy.enforcement.scheduler is Scheduler.REALTIME else ()),
    ]


def _unbound(policy: Policy, claim: Claim) -> list[str]:
    """What keeps the policy from being complete: containers misnamed, required tasks without pods, or no pod at all."""
    absent = claim.placement.absent - claim.misnamed.keys()
    missing = [task for task in policy.leaves if task.name in absent]
    none = bool(missing) and len(missing) == len(policy.leaves)
    return [
        *claim.misnamed.values(),
        *(f"task {task.name}: no running pod has {task.selector}" for task in missing if task.required or none),
    ]


def _application(mode: Mode, shadow: ShadowFacts | None, unapplied: Sequence[str]) -> ConditionFinding:
    """A shadow's containers are the other policy's: what keeps them from their shares is reported there."""
    good = "InForce" if mode.acts else mode.value
    if shadow is None:
        return ConditionFinding("Applied", good, "NotApplied", unapplied if mode.acts else ())
    if shadow.is_reverted and shadow.reverted is not None:
        reverted = f"the promotion was reverted at {shadow.reverted['time']}: {shadow.reverted['message']}"
        return ConditionFinding("Applied", good, "Reverted", [f"{reverted}; edit the spec to try again"])
    rival = [f"{shadow.rival} is already promoted: only one shadow of a policy can be"] if shadow.rival else []
    return ConditionFinding("Applied", "Promoted" if shadow.promoted else good, "NotApplied", rival)


def _shadow(planner: Planner, facts: ShadowFacts) -> dict[str, Any]:
    named = {task: dict(zip(("missesBefore", "misses"), known, strict=True)) for task, known in facts.misses.items()}
    return {
        "difference": _difference(planner.last, facts.decided)[:MAX_MESSAGE],
        "tasks": [
            {"name": task, **{name: round(part, 4) for name, part in known.items() if part is not None}}
            for task, known in named.items()
        ],
        "reverted": facts.reverted,
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


def _connection(*, connected: bool) -> ConditionFinding:
    return ConditionFinding("Connected", "Open", "NoRouter", () if connected else (NO_ROUTER,))


def _plan(planner: Planner, facts: StatusFacts) -> dict[str, Any] | None:
    plan = planner.decided
    if plan is None:
        return None
    made = timestamp(plan.time - facts.ahead)
    return {"run": facts.run, "sequence": plan.sequence, "time": made, "cause": plan.cause[:MAX_MESSAGE]}


def _nodes(planner: Planner, claim: Claim) -> list[dict[str, Any]]:
    nodes = planner.last.nodes if planner.last else {}
    factors = request_factors(planner.policy, claim.placement.containers, nodes, claim.agents, claim.room)
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
    found = (facts.claim.misnamed, facts.claim.obstacles)
    problems = [*shortfalls, *(known[name] for known in found if name in known)]
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


def remembered(status: Mapping[str, Any], policy: Policy) -> dict[str, Remembered]:
    """What the tasks had, by the status that an earlier operator wrote; nothing if it had no plan.

    A task without a pod had nothing: it was suspended for want of one, which says nothing of a pod that has come since.
    """
    if not status.get("plan"):
        return {}
    leaves = {task.name for task in policy.leaves}
    tasks: list[Mapping[str, Any]] = status.get("tasks") or []
    known = [task for task in tasks if {"name", "weight", "suspended"} <= task.keys()]
    had = [task for task in known if task.get("pods") or task["name"] not in leaves]
    return {task["name"]: Remembered(float(task["weight"]), bool(task["suspended"])) for task in had}
