"""Prometheus metrics of the chart's router."""

from __future__ import annotations

from prometheus_client import Counter, Gauge

CLIENTS = Gauge(
    "contextpolicy_router_clients", "Zenoh sessions that the router has: sensors, modules, operator, agents."
)
RESTARTS = Counter(
    "contextpolicy_router_restarts_total", "How often the router was killed and restarted in its container."
)
