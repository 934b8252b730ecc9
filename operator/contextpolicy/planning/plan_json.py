"""A plan as JSON: the one definition for the decision bus, `simulate --output json` and recordings.

CPU is in cores, with three decimals at most, whichever the scheduler, so shares read the same.

==========  ==========================================================================================================
field       meaning
==========  ==========================================================================================================
policy      `namespace/name`
mode        as in the policy: only what is decided in mode Enforce is carried out
scheduler   as in the policy
realtime    how budgets work under Realtime: `policy` (RR, FIFO) and `period` in seconds
control     as in the policy
sequence    counts the plans of a run (see below); the first plan with a number is carried out, later ones with the same
            number only update weights, scores and contexts: the shares are the same
time        when it takes effect: Unix seconds; in a simulation, seconds from the start of the timeline
cause       why it differs from the previous plan
contexts    the contexts that hold, in the order in which they apply
tasks       by name: `score`, `weight`, `share` (the sum over the task's containers), `suspended`, `because`
nodes       by name: `capacity` (N), `scheduler` (CFS where a node can't do Realtime), `dividedBy` (Weight; Priority
            where nothing is active; Nothing where all is suspended), `tasks` (each one's share there)
shortfalls  what the plan can't meet: a list of `task` and `message`
==========  ==========================================================================================================

The decision bus adds what only a running operator has:

==========  ==========================================================================================================
run         when the policy's runner was started, in milliseconds since 1970; (run, sequence, edition) only grows
edition     counts the messages with one sequence number: weights, scores or contexts changed, or containers were
            restarted or moved
targets     each container: `task`, `node`, `namespace`, `pod`, `uid`, `qos`, `container`, `containerId`, `cores` (its
            share); what an agent writes for it, `weight` (null: what it has; 0: the least) and `quota` (null: none),
            and whether the quota is `held` although the API can't have it; what it puts back in the end, the `original`
            limit before any policy (null: none); the `podLimit` that its pod has as a whole, which bounds all that
            (null: none); and what the kubelet has: `request` (what it has granted; null: nothing) and `limit` (what it
            reports as in force; null until it reports one)
trigger     when the sample that led to it arrived, in Unix seconds; absent from answers to queries
==========  ==========================================================================================================
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.policy.spec import Policy


def plan_json(policy: Policy, plan: Plan) -> dict[str, Any]:
    """What a plan says, JSON-serialisable."""
    return {
        "policy": policy.reference,
        "mode": policy.mode,
        "scheduler": policy.enforcement.scheduler,
        "realtime": {"policy": policy.enforcement.realtime_policy, "period": policy.enforcement.period},
        "control": policy.enforcement.control,
        "sequence": plan.sequence,
        "time": plan.time,
        "cause": plan.cause,
        "contexts": list(plan.contexts),
        "tasks": {
            name: {
                "score": task.score,
                "weight": task.weight,
                "share": task.share / 1000,
                "suspended": task.suspended,
                "because": task.because,
            }
            for name, task in plan.tasks.items()
        },
        "nodes": {
            name: {
                "capacity": node.capacity / 1000,
                "scheduler": node.scheduler,
                "dividedBy": node.basis,
                "tasks": {task: share / 1000 for task, share in node.shares.items()},
            }
            for name, node in plan.nodes.items()
        },
        "shortfalls": [{"task": shortfall.task, "message": shortfall.message} for shortfall in plan.shortfalls],
    }
