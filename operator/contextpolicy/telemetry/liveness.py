"""Whether the operator decides, and whether its loops answer, as metrics that need no loop's answer.

A loop that hangs takes with it all that `scrape` reads on it; what says so is read on the thread of the scrape.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from prometheus_client import Gauge
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

READY = Gauge(
    "contextpolicy_operator_ready",
    "1 while this replica is ready, as on /readyz: it decides, or could as soon as it leads.",
)


class LoopDelays(Collector):
    """`read` returns the seconds for which each loop has not answered, by name; it returns soon whatever hangs."""

    def __init__(self, read: Callable[[], Mapping[str, float]]) -> None:
        self._read = read

    def describe(self) -> Iterator[GaugeMetricFamily]:
        """The family, empty."""
        yield _family({})

    def collect(self) -> Iterator[GaugeMetricFamily]:
        """The delays as of now."""
        yield _family(self._read())


def _family(delays: Mapping[str, float]) -> GaugeMetricFamily:
    text = "Time for which the operator's loop has not responded; 0 while it responds."
    family = GaugeMetricFamily("contextpolicy_loop_delay_seconds", text, labels=["loop"])
    for loop, delay in delays.items():
        family.add_metric([loop], delay)
    return family
