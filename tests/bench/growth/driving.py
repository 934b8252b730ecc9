"""A robot that drives evenly: samples that change nothing, and the least that reading them can cost."""

from __future__ import annotations

import time
from statistics import median
from typing import TYPE_CHECKING, Any

from tests.bench.child import Child
from tests.bench.fleet.crowd import Fleet
from tests.bench.footprint.traffic import Samples
from tests.bench.live_case import KEYS, steady, steady_policy
from tests.bench.reaction.site import say

if TYPE_CHECKING:
    from collections.abc import Callable

    import zenoh

    from tests.bench.fleet.run import Run

TURNS, SECONDS = 3, 5.0
SETTLING = 0.5
"""Seconds until the first samples have arrived."""
AT_LEAST = "1m"
"""For how long a sample counts: the slowest stream, and one that pauses, must not change the plan either."""


class Driving(Fleet):
    """Its policies also read an IMU, as the live benchmark's."""

    def policy(self, namespace: str) -> dict[str, Any]:
        body, live = super().policy(namespace), steady_policy()["spec"]
        spec = body["spec"]
        first, *others = spec["tasks"]
        moving, context = live["tasks"][0]["activity"][0], live["contexts"][0]
        imu = {**live["streams"][0], "key": self.imu(namespace), "staleAfter": AT_LEAST}
        more = {
            "streams": [*spec["streams"], imu],
            "tasks": [{**first, "activity": [{**moving, "hold": AT_LEAST}]}, *others],
            "contexts": [{**context, "tasks": {first["name"]: {"weight": 8}}}, *spec["contexts"]],
        }
        return {**body, "spec": {**spec, **more}}

    def imu(self, namespace: str) -> str:
        return f"{namespace}/imu"

    def drive(self, bus: zenoh.Session, rate: int) -> Samples:
        """Samples of the first robot, from `with` to its end."""
        return samples(bus, self.imu(self.namespace(0)), rate)


def samples(bus: zenoh.Session, key: str, rate: int) -> Samples:
    """A robot that drives evenly, on this key, from `with` to its end."""
    return Samples(bus, {key: rate}, {key: steady})


def cost(run: Run, fleet: Driving, rate: int) -> dict[str, float]:
    """CPU in ms a second: the operator's, and of the floor, in turns; medians."""
    say(f"{rate} samples a second")
    live, floor = [], []
    with (
        Child("-m", "tests.bench.live_subject", "hand-over", run.router) as hand_over,
        Child("-m", "tests.bench.live_subject", "engine", run.router) as engine,
    ):
        for _ in range(TURNS):
            with fleet.drive(run.bus, rate):
                live.append(_spent(run.operator.cpu))
            with samples(run.bus, KEYS["hand-over"], rate):
                handed = _spent(lambda: hand_over.ask()["cpu"])
            floor.append(handed + engine.ask(rate=rate, count=round(rate * SECONDS))["us"] * rate / 1e3)
    return {"cpu_ms_per_s": round(median(live), 2), "floor_cpu_ms_per_s": round(median(floor), 2)}


def _spent(clock: Callable[[], float]) -> float:
    """Milliseconds of CPU a second."""
    time.sleep(SETTLING)
    before, began = clock(), time.monotonic()
    time.sleep(SECONDS)
    return (clock() - before) / (time.monotonic() - began) * 1e3
