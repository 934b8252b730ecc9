"""A storm of contexts: the plan turns every 5 ms for 2 s. Afterwards, how long until the newest plan is in force?"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from tests.bench.reaction.figures import percentile
from tests.bench.reaction.rounds import PAUSE, operated
from tests.bench.reaction.site import say

if TYPE_CHECKING:
    import zenoh

    from tests.bench.reaction.operated import Operated
    from tests.bench.reaction.site import Site
    from tests.bench.reaction.stopwatch import Stopwatch

PODS = 8
STORMS = 10
LENGTH, INTERVAL = 2.0, 0.005


def measure(site: Site, stopwatch: Stopwatch, buses: dict[str, zenoh.Session]) -> list[dict[str, Any]]:
    """One row for each of our paths."""
    names = [f"task-{number}" for number in range(PODS)]
    rows = []
    for namespace, bus in buses.items():
        site.pods(namespace, names)
        path = operated(site, stopwatch, namespace, bus, names)
        try:
            rows.append(_row(site, path))
        finally:
            path.close()
    return rows


def _row(site: Site, path: Operated) -> dict[str, Any]:
    say(f"storms: {path.name}")
    calm, storms = [], []
    for _ in range(STORMS):
        site.quiet.wait()
        calm.append(path.go()["all cgroups"])
        storms.append(_storm(path))
    return {
        "path": path.name,
        "pods": PODS,
        "calm_all_cgroups_ms_p50": round(percentile(calm, 50), 1),
        "calm_all_cgroups_ms_max": round(max(calm), 1),
        "after_storm_ms_p50": round(percentile([after for after, *_ in storms], 50), 1),
        "after_storm_ms_max": round(max(after for after, *_ in storms), 1),
        "plans": sum(plans for _, plans, _ in storms) // STORMS,
        "resizes": sum(resizes for *_, resizes in storms) // STORMS,
        "n": STORMS,
    }


def _storm(path: Operated) -> tuple[float, int, int]:
    """Milliseconds from the last sample until its plan is in force; how many plans and resizes there were."""
    began = time.time()
    while (last := path.turn()) < began + LENGTH:
        time.sleep(INTERVAL)
    path.await_limits(last)
    after = (time.time() - last) * 1e3
    time.sleep(PAUSE * 5)  # an agent's resizes follow when the plan has settled
    return after, path.plans_since(began), path.resizes_since(began)
