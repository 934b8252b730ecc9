"""Which version of which program answers, as a metric."""

from __future__ import annotations

from importlib.metadata import version

from prometheus_client import Gauge

BUILD = Gauge(
    "contextpolicy_build_info", "Always 1; the labels say which program of which version.", ["component", "version"]
)


def tell_build(component: str) -> None:
    """Export the installed version; `component` is operator, agent or router."""
    BUILD.labels(component, version("contextpolicy")).set(1)
