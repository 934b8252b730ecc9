"""Prometheus metrics: base units, no pod names or uids as labels."""

from __future__ import annotations

from prometheus_client import Counter, Gauge, Histogram

_LATENCY = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5)

STAGE_SECONDS = Histogram(
    "contextpolicy_stage_seconds",
    "Time from a sample's arrival until the plan that it made is there, its patch accepted, its limit in force.",
    ["policy", "stage"],
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
