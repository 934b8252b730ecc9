"""The sensors of a robot on its bus: an IMU at 200 Hz, a camera at 30 Hz, a microphone of 16 kHz in 50 chunks/s."""

from __future__ import annotations

import time
from functools import partial
from typing import TYPE_CHECKING

import zenoh

from tests.bench.live_case import steady
from tests.e2e.background import Background

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    Payload = Callable[[int], bytes]

RATES = {"imu": 200, "camera": 30, "microphone": 50}
IMAGE, CHUNK = bytes(30_000), bytes(640)
"""A JPEG of 640 x 480, and 20 ms of 16-bit samples."""
PAYLOADS: dict[str, Payload] = {
    "imu": steady,
    "camera": lambda _: IMAGE,
    "microphone": lambda _: CHUNK,
}


class Samples(Background):
    """Publishes on each key so many a second, from `with` to its end; none is lost, the publisher would wait."""

    def __init__(self, bus: zenoh.Session, rates: Mapping[str, int], payloads: Mapping[str, Payload]) -> None:
        super().__init__(*(partial(self._publish, _publisher(bus, key), rates[key], payloads[key]) for key in rates))

    def _publish(self, publisher: zenoh.Publisher, rate: int, payload: Payload) -> None:
        began, number = time.monotonic(), 0
        while not self._stop.wait(max(0.0, began + number / rate - time.monotonic())):
            publisher.put(payload(number))
            number += 1
        publisher.undeclare()


class Traffic(Samples):
    """All sensors; another session hears image and sound, as a module does."""

    def __init__(self, sensors: zenoh.Session, module: zenoh.Session, keys: dict[str, str]) -> None:
        rates = {keys[what]: rate for what, rate in RATES.items()}
        super().__init__(sensors, rates, {keys[what]: payload for what, payload in PAYLOADS.items()})
        self._heard = [module.declare_subscriber(keys[what], lambda _: None) for what in ("camera", "microphone")]

    def __exit__(self, *raised: object) -> None:
        super().__exit__(*raised)
        for subscriber in self._heard:
            subscriber.undeclare()


def _publisher(session: zenoh.Session, key: str) -> zenoh.Publisher:
    return session.declare_publisher(key, express=True, congestion_control=zenoh.CongestionControl.BLOCK)
