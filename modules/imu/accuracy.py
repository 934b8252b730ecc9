"""`python -m modules.imu.accuracy SEQUENCE ...`: how often the detector is right, on sequences with ground truth."""

from __future__ import annotations

import math
import sys
from bisect import bisect_left
from pathlib import Path
from typing import TYPE_CHECKING

from modules.imu.motion import MotionDetector, State, Thresholds
from robotkit import ConfigurationError, euroc
from robotkit.accuracy import Confusion

if TYPE_CHECKING:
    from collections.abc import Iterable

    from robotkit.euroc import TruePose
    from robotkit.readings import ImuSample

STILL_SPEED, STILL_RATE = 0.01, 0.02


def main(folders: list[str]) -> int:
    """Print one table over all sequences; exit code 2 for one that makes no sense."""
    confusion = Confusion()
    try:
        for folder in folders:
            mav0 = euroc.find(Path(folder))
            poses = euroc.truth(mav0)
            if not poses:
                raise euroc.DatasetError(f"{mav0 / euroc.TRUTH}: no ground truth")
            confusion.counts += compare(euroc.imu(mav0), poses).counts
    except ConfigurationError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    sys.stdout.write(f"{confusion.table()}\n\n{confusion.counts.total()} answers, {confusion.accuracy:.1%} right\n")
    return 0


def compare(samples: Iterable[ImuSample], poses: list[TruePose]) -> Confusion:
    """Ask after each sample that the ground truth covers, and compare with what was true at that instant."""
    detector, confusion = MotionDetector(), Confusion()
    stamps, states = [pose.stamp for pose in poses], true_states(poses)
    for sample in samples:
        motion = detector.feed(sample)
        if motion is not None and stamps[0] <= sample.stamp <= stamps[-1]:
            confusion.add(states[bisect_left(stamps, sample.stamp)], motion.state)
    return confusion


def true_states(poses: list[TruePose]) -> list[State]:
    """What the robot did at each pose: its speed, and its rate about the vertical."""
    rates = [_rate(poses[max(index - 1, 0)], poses[min(index + 1, len(poses) - 1)]) for index in range(len(poses))]
    return [_state(speed, rate) for speed, rate in zip(euroc.speeds(poses), rates, strict=True)]


def _state(speed: float, rate: float) -> State:
    if rate > Thresholds().turn:
        return State.TURNING
    return State.STILL if speed < STILL_SPEED and rate < STILL_RATE else State.MOVING


def _rate(before: TruePose, after: TruePose) -> float:
    seconds = (after.stamp - before.stamp) / 1e9
    turned = math.remainder(_yaw(after) - _yaw(before), 2 * math.pi)
    return abs(turned) / seconds if seconds > 0 else 0.0


def _yaw(pose: TruePose) -> float:
    w, x, y, z = pose.orientation
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
