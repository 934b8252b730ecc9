"""The sensors of a robot on its bus: an IMU at 200 Hz, a camera at 30 Hz, a microphone of 16 kHz in 50 chunks/s."""

from __future__ import annotations

import time
from functools import partial
from typing import TYPE_CHECKING

import zenoh

from tests.bench.live_case import steady
from tests.e2e.background import Background

if TYPE_CHECKING:
    from collections.abc import Callable

RATES = {"imu": 200, "camera": 30, "microphone": 50}
IMAGE, CHUNK = bytes(30_000), bytes(640)
"""A JPEG of 640 x 480, and 20 ms of 16-bit samples."""
PAYLOADS: dict[str, Callable[[int], bytes]] = {
    "imu": steady,
    "camera": lambda _: IMAGE,
    "microphone": lambda _: CHUNK,
}


class Traffic(Background):
    """Publishes from `with` to its end; another session hears image and sound, as a module does."""

    def __init__(self, sensors: zenoh.Session, module: zenoh.Session, keys: dict[str, str]) -> None:
        super().__init__(
            *(
                partial(self._publish, _publisher(sensors, keys[what]), rate, PAYLOADS[what])
                for what, rate in RATES.items()
            )
        )
        self._heard = [module.declare_subscriber(keys[what], lambda _: None) for what in ("camera", "microphone")]

    def __exit__(self, *raised: object) -> None:
        super().__exit__(*raised)
        for subscriber in self._heard:
            subscriber.undeclare()

    def _publish(self, publisher: zenoh.Publisher, rate: int, payload: Callable[[int], bytes]) -> None:
        began, number = time.monotonic(), 0
        while not self._stop.wait(max(0.0, began + number / rate - time.monotonic())):
            publisher.put(payload(number))
            number += 1
        publisher.undeclare()


def _publisher(session: zenoh.Session, key: str) -> zenoh.Publisher:
    return session.declare_publisher(key, express=True, congestion_control=zenoh.CongestionControl.BLOCK)
