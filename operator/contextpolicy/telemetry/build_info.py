"""The program, its version and its start time, as metrics."""

from __future__ import annotations

import time
from importlib.metadata import version

from prometheus_client import Gauge

BUILD = Gauge(
    "contextpolicy_build_info", "Always 1; the labels name the program and its version.", ["component", "version"]
)
STARTED = Gauge(
    "contextpolicy_start_timestamp_seconds",
    "When the program started, in Unix seconds by the clock of that moment.",
    ["component"],
)


def publish_build(component: str) -> None:
    """Export the installed version, and that it starts now; `component` is operator, agent, router or fleet-router."""
    BUILD.labels(component, version("contextpolicy")).set(1)
    STARTED.labels(component).set(time.time())
