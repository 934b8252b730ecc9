"""From raw IMU samples to what the robot does."""

from __future__ import annotations

from typing import TYPE_CHECKING

from modules.imu.motion import MotionDetector, State
from robotkit import Result, Task, euroc
from robotkit.playback import Playback
from robotkit.readings import ImuSample, imu

if TYPE_CHECKING:
    import threading
    from collections.abc import Generator
    from pathlib import Path

    from robotkit import Received

EVERY_NS = 20_000_000
"""A policy decides no better with more than 50 samples a second."""


class Imu(Task):
    """Takes samples from the bus, or plays those of a sequence."""

    def __init__(self, sequence: Path | None = None) -> None:
        self._mav0 = None if sequence is None else euroc.find(sequence)
        self._playback = Playback()
        self._detector = MotionDetector()
        self._reported: int | None = None

    def process(self, received: Received) -> list[Result]:
        """Take a sample; returns a result at most every 20 ms."""
        return self._results(imu(received))

    def produce(self, ended: threading.Event) -> Generator[Result]:
        """Play the sequence, if there is one, with the stamps of now."""
        if self._mav0 is None:
            return
        recorded = ((sample.stamp, sample) for sample in euroc.imu(self._mav0))
        for due, sample in self._playback.play(recorded, ended):
            yield from self._results(ImuSample(due, sample.gyro, sample.accel))

    def _results(self, sample: ImuSample) -> list[Result]:
        motion = self._detector.feed(sample)
        if self._reported is not None and 0 <= sample.stamp - self._reported < EVERY_NS:
            return []
        self._reported = sample.stamp
        content: dict[str, object] = {"gyro": sample.gyro, "accel": sample.accel}
        if motion is not None:
            content |= {
                "motion": motion.state,
                "moving": motion.state is not State.STILL,
                "turning": motion.state is State.TURNING,
                "rate": round(motion.rate, 4),
            }
        return [Result("motion", content, sample.stamp)]
