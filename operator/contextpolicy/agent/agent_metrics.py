"""What the agent counts and measures, for Prometheus."""

from __future__ import annotations

from prometheus_client import Counter, Gauge, Histogram

REFUSALS = Counter(
    "contextpolicy_agent_refusals_total", "Orders that the agent refused or failed to carry out.", ["reason"]
)
for _reason in ("Unsigned", "Forged", "TooOld", "Repeated"):
    REFUSALS.labels(_reason)  # counts from 0: `increase()` does not see a series that appears with its first forgery
WRITES = Counter("contextpolicy_agent_writes_total", "Writes of cgroup files by result.", ["result"])
CONNECTED = Gauge("contextpolicy_agent_bus_connected", "1 while the agent has a session with a router.")
OBEYED_SECONDS = Histogram(
    "contextpolicy_agent_plan_seconds",
    "Time from a plan's signing until its limits are written, by the node's clock.",
    buckets=(0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5),
)
