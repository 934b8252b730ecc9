"""The policies of the live benchmark, and the samples that their streams get."""

from __future__ import annotations

import json
import time
from typing import Any

from tests.planning.builders import a_context, a_stream, a_task
from tests.policies.builders import a_policy

KEYS = {kind: f"bench/{kind}" for kind in ("bare", "hand-over", "operator", "storm")}
SHARES = {0: 200, 1: 800}
"""What slam gets, in thousandths of the one core, after a stormy sample whose `last` is the key."""


def steady_policy() -> dict[str, Any]:
    """As the delivery robot's: its samples renew what holds, and change nothing."""
    moving = {"stream": "imu", "when": "norm(imu.gyro) > 0.02", "hold": "1s"}
    policy: dict[str, Any] = a_policy(
        streams=[a_stream("imu", key=KEYS["operator"], timestamp="stamp", staleAfter="10s")],
        tasks=[a_task("slam", idle=0.1, activity=[moving]), a_task("speech")],
        contexts=[a_context("moving", "imu.speed > 0.05", {"slam": {"weight": 8}}, enterAfter="100ms", exitAfter="1s")],
    )
    return policy


def stormy_policy() -> dict[str, Any]:
    """Every sample makes another plan."""
    policy: dict[str, Any] = a_policy(
        streams=[a_stream("imu", key=KEYS["storm"], timestamp="stamp")],
        tasks=[a_task("slam", idle=0.01, activity=[{"stream": "imu", "scoreFrom": "imu.score"}]), a_task("speech")],
        contexts=[],
    )
    return policy


def steady(number: int) -> bytes:
    """A robot that drives evenly; the last digits are noise, as of any sensor."""
    noise = number % 97 * 1e-5
    return _payload(gyro=[0.1 + noise, -0.2, 0.3], accel=[0.01, 0.02 + noise, 9.81], speed=0.3)


def stormy(number: int, last: int | None = None) -> bytes:
    """Any score but those of `SHARES`; one of those when it is the `last` that asks for it."""
    score = 0.5 + number % 89 / 100 if last is None else SHARES[last] / (1000 - SHARES[last])
    return _payload(score=score)


def _payload(**value: Any) -> bytes:
    return json.dumps({"stamp": time.time_ns(), **value}).encode()
