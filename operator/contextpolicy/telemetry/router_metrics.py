"""Prometheus metrics of the chart's router."""

from __future__ import annotations

from prometheus_client import Gauge

CLIENTS = Gauge(
    "contextpolicy_router_clients", "Zenoh sessions that the router has: sensors, modules, operator, agents."
)
