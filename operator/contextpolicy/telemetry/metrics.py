"""Prometheus metrics of what happens: base units, and labels that name policies and their parts, never a pod's UID.

`namespace` and `name` are the policy's, so that they join with what other exporters say about either. What is the case
at the moment of a scrape (silent streams, limits, conditions) is read then: see `scrape`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from prometheus_client import Counter, Gauge, Histogram

from contextpolicy.policy.spec import Mode

if TYPE_CHECKING:
    from collections.abc import Iterable

    from prometheus_client.metrics import MetricWrapperBase

    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.policy.spec import Policy

POLICY = ("namespace", "name")
_LATENCY = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 3, 5, 10)
"""3 is an old kubelet's 2 s and one more: read from between 2 and 5, a quantile would be far too large."""

SAMPLE_TO_PLAN = Histogram(
    "contextpolicy_sample_to_plan_seconds",
    "Time from a sample's arrival until the plan that it caused is ordered.",
    POLICY,
    buckets=_LATENCY,
)
PLAN_TO_PATCH = Histogram(
    "contextpolicy_plan_to_patch_seconds",
    "Time from ordering a plan until the API server has accepted a new limit of a container.",
    POLICY,
    buckets=_LATENCY,
)
PATCH_TO_IN_FORCE = Histogram(
    "contextpolicy_patch_to_in_force_seconds",
    "Time from the API server's acceptance of a limit until the kubelet reports it in force.",
    POLICY,
    buckets=_LATENCY,
)
REACTION = Histogram(
    "contextpolicy_reaction_seconds",
    "Time from a sample's arrival until what it caused is in force, as the node's agent or the kubelet confirms.",
    POLICY,
    buckets=_LATENCY,
)
PLANS = Counter("contextpolicy_plans_total", "Plans made.", POLICY)
DROPS = Counter("contextpolicy_samples_dropped_total", "Samples not used.", [*POLICY, "stream", "reason"])
HELD_BACK = Counter("contextpolicy_plans_held_back_total", "Plans that minDwell held back.", POLICY)
CONTEXT_ACTIVE = Gauge("contextpolicy_context_active", "1 while the context is active.", [*POLICY, "context"])
TASK_SHARE = Gauge(
    "contextpolicy_task_share_cores", "The task's share; absent for a task made of subtasks.", [*POLICY, "task"]
)
TASK_WEIGHT = Gauge(
    "contextpolicy_task_weight", "The task's weight; absent for a task made of subtasks.", [*POLICY, "task"]
)
RESIZES = Counter("contextpolicy_resizes_total", "Patches of pods/resize by result.", [*POLICY, "result"])
CONFLICTS = Counter(
    "contextpolicy_conflicts_total",
    "How often another writer changed the CPU of a container of the policy.",
    POLICY,
)
API_REQUESTS = Counter(
    "contextpolicy_api_requests_total",
    "Requests to the API server by HTTP method and status code, which is `none` without an answer.",
    ["method", "code"],
)
EVENTS_LEFT_OUT = Counter(
    "contextpolicy_events_left_out_total", "Events on a policy that were not posted, to limit their rate.", POLICY
)

_KNOWN_BEFOREHAND = (
    SAMPLE_TO_PLAN,
    PLAN_TO_PATCH,
    PATCH_TO_IN_FORCE,
    REACTION,
    PLANS,
    HELD_BACK,
    CONFLICTS,
    EVENTS_LEFT_OUT,
)
"""Those that need no label but the policy's."""
_OF_A_PLAN = (CONTEXT_ACTIVE, TASK_SHARE, TASK_WEIGHT)
"""Those that say what the plan in force is."""
_OF_A_POLICY = (*_KNOWN_BEFOREHAND, *_OF_A_PLAN, DROPS, RESIZES)


class RequestCount:
    """Counts the API server's answers."""

    def on_answer(self, method: str, code: str) -> None:
        """See `AnswerListener`."""
        API_REQUESTS.labels(method, code).inc()


def labels(policy: str) -> tuple[str, str]:
    """The first two labels of everything here, from the policy's `namespace/name`."""
    namespace, _, name = policy.partition("/")
    return namespace, name


def begin(policy: str) -> None:
    """The policy starts: count from 0, because the first increase of a series that was not there is not seen."""
    for metric in _KNOWN_BEFOREHAND:
        metric.labels(*labels(policy))


def measure(policy: Policy, plan: Plan) -> None:
    """What the plan gives each task that it divides a node among, and which contexts hold.

    A task made of subtasks is left out, so that the weights of a policy add up to what the plan divides by.
    """
    own = labels(policy.reference)
    for context in policy.contexts:
        CONTEXT_ACTIVE.labels(*own, context.name).set(context.name in plan.contexts)
    divided = {name for node in plan.nodes.values() for name in node.shares}
    for name in (leaf.name for leaf in policy.leaves):
        if name in divided:
            TASK_SHARE.labels(*own, name).set(plan.tasks[name].share / 1000)
            TASK_WEIGHT.labels(*own, name).set(plan.tasks[name].weight)
        else:
            TASK_SHARE.remove(*own, name)
            TASK_WEIGHT.remove(*own, name)


def end(policy: str) -> None:
    """Nothing of the policy is in force any more; what it has counted goes on, until it is gone."""
    _remove(policy, _OF_A_PLAN)


def forget(policy: str) -> None:
    """The policy is gone, and all that was measured of it."""
    _remove(policy, _OF_A_POLICY)


def replace(before: Policy, after: Policy) -> None:
    """The policy was edited: what it lost is gone; a paused one gives no task anything, and no context has effects."""
    own = {"namespace": before.namespace, "name": before.name}
    for stream in {one.name for one in before.streams} - {one.name for one in after.streams}:
        DROPS.remove_by_labels({**own, "stream": stream})
    kept = after if after.mode is not Mode.PAUSED else None
    for context in {one.name for one in before.contexts} - {one.name for one in (kept.contexts if kept else ())}:
        CONTEXT_ACTIVE.remove_by_labels({**own, "context": context})
    for task in {one.name for one in before.leaves} - {one.name for one in (kept.leaves if kept else ())}:
        TASK_SHARE.remove_by_labels({**own, "task": task})
        TASK_WEIGHT.remove_by_labels({**own, "task": task})


def _remove(policy: str, measured: Iterable[MetricWrapperBase]) -> None:
    namespace, name = labels(policy)
    for metric in measured:
        metric.remove_by_labels({"namespace": namespace, "name": name})
