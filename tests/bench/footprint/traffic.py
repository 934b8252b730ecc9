"""The sensors of a robot on its bus: an IMU at 200 Hz, a camera at 30 Hz, a microphone of 16 kHz in 50 chunks/s."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Self

import zenoh

from tests.bench.live_case import steady

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


class Traffic:
    """Publishes from `with` to its end; another session hears image and sound, as a module does."""

    def __init__(self, sensors: zenoh.Session, module: zenoh.Session, keys: dict[str, str]) -> None:
        self._stop = threading.Event()
        self._heard = [module.declare_subscriber(keys[what], lambda _: None) for what in ("camera", "microphone")]
        self._threads = [
            threading.Thread(target=self._publish, args=(_publisher(sensors, keys[what]), rate, PAYLOADS[what]))
            for what, rate in RATES.items()
        ]

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        for thread in self._threads:
            thread.join()
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
