"""Why each task has its share: everything that led to the plan in force, as plain data.

The same structure answers a query on the decision bus, `explain --output json` and, through `sentences`, people.
CPU is in thousandths of a core, times and ages in seconds. A node's `scheduler` is the one it is divided for, which is
not the policy's if the node can't do realtime.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from contextpolicy.errors import ShareError
from contextpolicy.explain.deciding import absence, deciding_parts
from contextpolicy.explain.excerpt import excerpt
from contextpolicy.planning.allocation.division import terms
from contextpolicy.planning.allocation.influence import influence
from contextpolicy.planning.allocation.shares import divide, floors_exceed
from contextpolicy.policy.quantities import format_cpu

if TYPE_CHECKING:
    from collections.abc import Sequence

    from contextpolicy.planning.allocation.division import Terms
    from contextpolicy.planning.allocation.plan import NodePlan, Plan
    from contextpolicy.planning.conditions.context import ContextState
    from contextpolicy.planning.conditions.expressions import Guarded
    from contextpolicy.planning.conditions.initiative import Initiative
    from contextpolicy.planning.conditions.stream import StreamState
    from contextpolicy.planning.planner import Planner
    from contextpolicy.policy.spec import Context, Effect, Task


def explain(planner: Planner, now: float, ahead: float = 0.0) -> dict[str, Any]:
    """The plan in force and its reasons, JSON-serialisable; before the first plan `plan` is None and tasks are empty.

    Scores, weights and contexts are those of `now`, even if they moved no share since the plan was made. `now` is
    planning time, which is `ahead` seconds of the wall clock; times in the document are the wall clock's.
    """
    plan, policy = planner.last, planner.policy
    return {
        "policy": policy.reference,
        "mode": policy.mode,
        "scheduler": policy.enforcement.scheduler,
        "control": policy.enforcement.control,
        "time": now - ahead,
        "plan": _plan(planner, now, ahead),
        "minDwell": policy.enforcement.min_dwell,
        "heldBack": planner.held_back,
        "streams": {name: _stream(stream, now) for name, stream in planner.streams.items()},
        "contexts": {context.spec.name: _context(planner, context, now) for context in planner.contexts},
        "nodes": _nodes(planner, plan) if plan else {},
        "tasks": {task.name: _task(planner, plan, task, now) for task in policy.tasks} if plan else {},
        "errors": dict(planner.errors),
        "drops": [{"stream": s, "reason": r, "count": count} for (s, r), count in sorted(planner.drops.items())],
    }


def _plan(planner: Planner, now: float, ahead: float) -> dict[str, Any] | None:
    plan, decided = planner.last, planner.decided
    if plan is None or decided is None:
        return None
    # The last plan may only have new weights; the one that decided the shares in force has their time and cause.
    return {
        "sequence": decided.sequence,
        "time": decided.time - ahead,
        "age": round(now - decided.time, 6),
        "cause": decided.cause,
        "contexts": list(plan.contexts),
        "shortfalls": [{"task": shortfall.task, "message": shortfall.message} for shortfall in plan.shortfalls],
    }


def _stream(stream: StreamState, now: float) -> dict[str, Any]:
    return {
        "key": stream.spec.key,
        "value": excerpt(stream.value),
        "features": excerpt(stream.features(now)),
        "age": None if stream.seen_at is None else round(now - stream.seen_at, 6),
        "counts": stream.fresh,
        "silent": stream.silent,
        "staleAfter": stream.spec.stale_after,
        "producedBy": stream.spec.produced_by,
    }


def _context(planner: Planner, context: ContextState, now: float) -> dict[str, Any]:
    """`decidedBy`: the parts that decide `when`, or `until` while it holds.

    `turnsIn`: seconds until it turns if that stays so.
    """
    turns_at = context.turns_at
    return {
        "active": context.active,
        "holds": context.holds,
        "when": context.spec.when,
        "until": context.spec.until,
        "streams": [stream.spec.name for stream in context.streams],
        "insisted": sorted(context.insisted),
        "decidedBy": _decided_by(planner, context.deciding, now),
        "turnsIn": None if turns_at is None else round(turns_at - now, 6),
    }


def _decided_by(planner: Planner, condition: Guarded | None, now: float) -> list[dict[str, Any]]:
    parts = deciding_parts(condition, planner.streams, now) if condition else []
    return [part | {"value": excerpt(part["value"]), "operands": excerpt(part["operands"])} for part in parts]


def _task(planner: Planner, plan: Plan, task: Task, now: float) -> dict[str, Any]:
    own = plan.tasks[task.name]
    parent = next((other.name for other in planner.policy.tasks if task.name in other.subtasks), None)
    names = {context.spec.name for context in planner.active_contexts()}
    active = [context for context in planner.policy.contexts if context.name in names]
    return {
        "score": own.score,
        "weight": own.weight,
        "share": own.share,
        "suspended": own.suspended,
        "because": own.because,
        "protected": task.protected,
        "priority": task.priority,
        "idle": task.idle,
        "activity": [_activity(planner, own, now) for own in planner.initiatives[task.name]],
        "requires": [
            _initiative(planner, own, now) | {"met": own.value > 0} for own in planner.requirements[task.name]
        ],
        "requiredTasks": {name: planner.weights[name].able for name in task.required_tasks},
        "contexts": [context.name for context in planner.policy.contexts if task.name in context.effects],
        "effects": _effects(active, task),
        "parent": parent,
        "subtasks": list(task.subtasks),
        "satisfiedBy": task.satisfied_by if task.subtasks else None,
        "needs": _needs(planner, plan, task),
        "shortfalls": [shortfall.message for shortfall in plan.shortfalls if shortfall.task == task.name],
    }


def _activity(planner: Planner, initiative: Initiative, now: float) -> dict[str, Any]:
    spec, carrier = initiative.spec, initiative.carrier
    return _initiative(planner, initiative, now) | {
        "score": spec.score,
        "scoreFrom": spec.score_from,
        "matches": initiative.matches,
        "decaysFrom": initiative.decays_from(now),
        "scoreDecidedBy": _decided_by(planner, initiative.score, now),
        "absent": absence(carrier, now) if carrier and not carrier.fresh else None,
    }


def _initiative(planner: Planner, initiative: Initiative, now: float) -> dict[str, Any]:
    own = initiative if initiative.spec.initiative is None else None
    return {
        "when": initiative.spec.when,
        "until": initiative.spec.until,
        "initiative": initiative.spec.initiative,
        "streams": [stream.spec.name for stream in initiative.streams],
        "hold": initiative.spec.hold,
        "value": initiative.value,
        "decidedBy": _decided_by(planner, own.deciding, now) if own else [],
    }


def _effects(active: Sequence[Context], task: Task) -> list[dict[str, Any]]:
    """What the contexts in force do to a task, and which of that counts; none suspends a protected task."""
    effects = {context.name: context.effects[task.name] for context in active if task.name in context.effects}
    ruled_out = {name for name, effect in effects.items() if task.protected and effect.suspends}
    together = influence(task, active)
    if together.suspended_by is not None:
        counts = {together.suspended_by.name}
    else:
        counts = {context.name for context in together.weighting}
        counts |= {name for name, effect in effects.items() if effect.suspend is False or effect.bounds}
    return [
        {"context": name, "change": change(effect), "decides": name in counts, "ruledOut": name in ruled_out}
        for name, effect in effects.items()
    ]


def change(effect: Effect) -> str:
    """A context's effect in a few words."""
    if effect.suspend:
        return "suspends it"
    parts = ["lets it run"] if effect.suspend is False else []
    if effect.weight is not None:
        parts.append(f"sets its weight to {effect.weight:g}")
    if effect.scale is not None:
        parts.append(f"scales its weight by {effect.scale:g}")
    if effect.min is not None:
        parts.append(f"gives it at least {format_cpu(effect.min)}")
    if effect.max is not None:
        parts.append(f"caps it at {format_cpu(effect.max)}")
    return " and ".join(parts)


def _needs(planner: Planner, plan: Plan, task: Task) -> list[dict[str, Any]]:
    """Each capability constraint with what the worst-served container gets."""
    nodes = {node.name: node for node in planner.seating().nodes if node.name in plan.nodes}
    shares = [
        (nodes[container.node], plan.nodes[container.node].containers[container.id])
        for container in planner.placement.containers
        if container.task == task.name and container.node in nodes
    ]
    if not shares:
        return []
    cores = min(share for _, share in shares)
    gap = max(node.throttle_gap(share) for node, share in shares)
    memory = [c.memory for c in planner.placement.containers if c.task == task.name and c.memory is not None]
    rows = [
        ("cores", task.needs.cores, cores, task.needs.cores is not None and cores >= task.needs.cores),
        ("memory", task.needs.memory, min(memory, default=None), not memory or min(memory) >= (task.needs.memory or 0)),
        ("deadline", task.needs.deadline, gap, task.needs.deadline is not None and gap <= task.needs.deadline),
    ]
    return [{"need": n, "wanted": wanted, "given": given, "met": met} for n, wanted, given, met in rows if wanted]


def _nodes(planner: Planner, plan: Plan) -> dict[str, Any]:
    divided = terms(planner.seating(), planner.weights, planner.at_rest)
    return {node: _node(divided[node], made) for node, made in plan.nodes.items() if node in divided}


def _node(own: Terms, made: NodePlan) -> dict[str, Any]:
    total = sum(claim.weight for claim in own.claims)
    rows = {}
    for claim in own.claims:
        proportional = own.capacity * claim.weight / total if total else 0.0
        floor, ceiling, share = claim.floor * own.quantum, claim.ceiling * own.quantum, made.shares.get(claim.name, 0)
        rows[claim.name] = {
            "weight": claim.weight,
            "proportional": round(proportional, 3),
            "floor": floor,
            "ceiling": ceiling,
            "share": share,
            "bound": _bound(share, proportional, floor, ceiling),
        }
    return {
        "scheduler": made.scheduler,
        "capacity": made.capacity,
        "dividedBy": made.basis,
        "step": own.quantum,
        "weights": total,
        "floorsExceed": floors_exceed(own.capacity // own.quantum, own.claims),
        "current": _divides_so(own, made),
        "tasks": rows,
    }


def _divides_so(own: Terms, made: NodePlan) -> bool:
    """Whether the current weights give the shares in force; they may not while minDwell keeps the last plan."""
    try:
        units = divide(own.capacity // own.quantum, own.claims)
    except ShareError:
        return False
    return {name: share * own.quantum for name, share in units.items()} == dict(made.shares)


def _bound(share: int, proportional: float, floor: int, ceiling: int) -> str | None:
    """The bound that keeps the share from what the weight alone would buy."""
    if share == floor and proportional < floor:
        return "floor"
    if share == ceiling and proportional > ceiling:
        return "ceiling"
    return None
