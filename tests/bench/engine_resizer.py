"""What one plan costs the loop in the resizer: from the order until every limit is in force.

The API server and the kubelet are a fake's, and their time is left out; so is that of reading pods, which the watch's
thread does.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from statistics import median
from time import perf_counter
from typing import TYPE_CHECKING

from contextpolicy.cluster.pod_parsing import view
from tests.actuators.resize.rig import MOMENT, POLICY, Rig, by_id
from tests.cluster.builders import a_pod, cpu

if TYPE_CHECKING:
    from collections.abc import Callable

LIMITS, BYSTANDERS, PLANS = 30, 80, 20
NAMES = [f"task-{number}" for number in range(LIMITS)]


@dataclass(slots=True)
class Clock:
    """The time spent in the loop's own work."""

    seconds: float = 0.0
    marks: list[float] = field(default_factory=list)

    def run(self, act: Callable[[], object]) -> None:
        began = perf_counter()
        act()
        self.seconds += perf_counter() - began

    def lap(self) -> None:
        self.marks.append(self.seconds)
        self.seconds = 0.0


def loop_ms_per_plan() -> float:
    """The median over plans that move every limit, half of them up."""
    rig, clock = _rig(), Clock()
    for number in range(PLANS):
        high, low = (40, 20) if number % 2 else (20, 40)
        shares = by_id({name: high if index % 2 else low for index, name in enumerate(NAMES)})
        clock.run(lambda shares=shares: rig.order(POLICY, shares, n=30 * LIMITS))  # type: ignore[misc]
        while rig.workers.jobs:
            while rig.workers.jobs:
                rig.workers.run()
            clock.run(lambda: rig.wait(MOMENT))
            _confirm(rig, clock)
        rig.wait(1.0)
        clock.lap()
    return median(clock.marks[2:]) * 1000


def loop_us_per_bystander() -> float:
    """The median cost of news about a pod that no policy has to do with."""
    rig, clock = _rig(), Clock()
    rig.order(POLICY, by_id(dict.fromkeys(NAMES, 30)), n=30 * LIMITS)
    rig.settle()
    for number in range(BYSTANDERS):
        rig.cluster.report(f"uid-other-{number}")
        seen = view(rig.cluster.feeds[f"uid-other-{number}"].popleft())
        clock.run(lambda seen=seen: rig.resizer.observe(seen))  # type: ignore[misc]
        clock.run(lambda: rig.wait(MOMENT))
        clock.lap()
    return median(clock.marks) * 1e6


def _rig() -> Rig:
    rig = Rig(
        *(a_pod(name, {name: cpu("10m", "30m")}) for name in NAMES),
        *(a_pod(f"other-{number}") for number in range(BYSTANDERS)),
    )
    for feed in rig.cluster.feeds.values():
        feed.clear()
    return rig


def _confirm(rig: Rig, clock: Clock) -> None:
    """The kubelet does what it was asked, and the watch reports it, pod by pod."""
    for name in NAMES:
        uid = f"uid-{name}"
        if rig.cluster.feeds[uid]:
            rig.cluster.confirm(uid)
        while rig.cluster.feeds[uid]:
            seen = view(rig.cluster.feeds[uid].popleft())
            clock.run(lambda seen=seen: rig.resizer.observe(seen))  # type: ignore[misc]
    clock.run(lambda: rig.wait(MOMENT))
