"""Prometheus metrics of what happens: base units, and labels that name policies and their parts, never a pod's UID.

What is the case at the moment of a scrape (silent streams, limits, conditions) is read then: see `scrape`.
"""

from __future__ import annotations

from prometheus_client import Counter, Gauge, Histogram

_LATENCY = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5)

_POLICY = ["namespace", "name"]

SAMPLE_TO_PLAN = Histogram(
    "contextpolicy_sample_to_plan_seconds",
    "Time from a sample's arrival until the plan that it caused is ordered.",
    _POLICY,
    buckets=_LATENCY,
)
PLAN_TO_PATCH = Histogram(
    "contextpolicy_plan_to_patch_seconds",
    "Time from such a plan until the API has accepted a new limit of a container.",
    _POLICY,
    buckets=_LATENCY,
)
PATCH_TO_IN_FORCE = Histogram(
    "contextpolicy_patch_to_in_force_seconds",
    "Time from then until the kubelet reports the limit in force.",
    _POLICY,
    buckets=_LATENCY,
)
REACTION = Histogram(
    "contextpolicy_reaction_seconds",
    "Time from a sample's arrival until the kubelet reports a limit that it caused in force.",
    _POLICY,
    buckets=_LATENCY,
)
PLANS = Counter("contextpolicy_plans_total", "Plans made.", ["policy"])
DROPS = Counter("contextpolicy_samples_dropped_total", "Samples not used.", ["policy", "stream", "reason"])
HELD_BACK = Counter("contextpolicy_plans_held_back_total", "Plans that minDwell held back.", ["policy"])
CONTEXT_ACTIVE = Gauge("contextpolicy_context_active", "1 while the context has effects.", ["policy", "context"])
TASK_SHARE = Gauge("contextpolicy_task_share_cores", "What the plan gives the task.", ["policy", "task"])
TASK_WEIGHT = Gauge("contextpolicy_task_weight", "The task's weight.", ["policy", "task"])
RESIZES = Counter("contextpolicy_resizes_total", "Patches of pods/resize by result.", ["policy", "result"])
CONTESTS = Counter(
    "contextpolicy_contests_total", "Times that somebody else changed the CPU of a container of the policy.", ["policy"]
)
API_REQUESTS = Counter(
    "contextpolicy_api_requests_total",
    "Requests to the API server by HTTP method and status code; the code of one without an answer is `none`.",
    ["method", "code"],
)
EVENTS_LEFT_OUT = Counter(
    "contextpolicy_events_left_out_total", "Events on a policy that were not posted, because it had too many.", _POLICY
)
