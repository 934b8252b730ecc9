"""A VerticalPodAutoscaler, in place: from a step of a task's load until the task's CPU limit is a higher one.

It knows nothing of contexts; it sees what was used. It looks every 10 s, the least that its metrics-server takes
(as installed, it looks every minute). Each round has a task of its own: what it saw of one weighs for days.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from tests.bench.reaction import objects
from tests.bench.reaction.figures import rounded
from tests.bench.reaction.site import PLAIN, say
from tests.e2e.cluster import apply, run
from tests.node import autoscaler

if TYPE_CHECKING:
    from tests.bench.reaction.journal import Journal
    from tests.bench.reaction.site import Site
    from tests.bench.reaction.stopwatch import Stopwatch
    from timelines.demo.cgroup import Cgroup

STEP = "autoscaler: load step"
LEAST, LIMIT = "100m", 0.2
"""Request and limit (cores) of an idle task; the autoscaler keeps their ratio."""
MOST = 5
"""Rounds at once, so that all of them together fit on a small node."""
WARM = 60.0
"""Seconds for which it sees idle tasks."""
PATIENCE, AGAIN = 300.0, 20.0
"""Seconds to wait for it, and between two signals: a worker works for 30 s after one signal."""


def measure(site: Site, stopwatch: Stopwatch, journal: Journal, rounds: int) -> None:
    """One row for all rounds, which run side by side: with little more than LIMIT each, none is in another's way."""
    journal.once(STEP, lambda: [_row(site, stopwatch, min(rounds, MOST))])


def _row(site: Site, stopwatch: Stopwatch, rounds: int) -> dict[str, Any]:
    names = [f"scaled-{number}" for number in range(rounds)]
    with autoscaler.running():
        site.replicated(PLAIN, [objects.scaled_pod(name, PLAIN, LEAST, LIMIT) for name in names])
        apply(*(objects.autoscaler(name, PLAIN, "cpu", minAllowed={"cpu": LEAST}) for name in names))
        targets = [f"vpa/{name}" for name in names]
        run("kubectl", "wait", *targets, "-n", PLAIN, "--for=condition=RecommendationProvided", "--timeout=120s")
        say(f"the autoscaler sees idle tasks for {WARM:g} s")
        time.sleep(WARM)
        took = _step(site, stopwatch, names)
    return {
        "rounds": rounds,
        "raised_s_p50": rounded(took, 50),
        "raised_s_least": min(took, default=None),
        "raised_s_most": max(took, default=None),
        "missed": rounds - len(took),
    }


def _step(site: Site, stopwatch: Stopwatch, names: list[str]) -> list[float]:
    """Seconds after which each task had a higher limit, of those that got one."""
    groups = [site.groups[PLAIN][name] for name in names]
    began = time.time()
    try:
        while time.time() < began + PATIENCE and len(_raised(stopwatch, groups, began)) < len(groups):
            site.signal(PLAIN, names, on=True)
            time.sleep(AGAIN)
    finally:
        site.signal(PLAIN, names, on=False)
    return [round(at - began, 1) for at in _raised(stopwatch, groups, began).values()]


def _raised(stopwatch: Stopwatch, groups: list[Cgroup], since: float) -> dict[Cgroup, float]:
    """When each group's limit first rose."""
    found: dict[Cgroup, float] = {}
    for at, group, cores in stopwatch.steps(groups, since):
        if cores > LIMIT:
            found.setdefault(group, at)
    return found
