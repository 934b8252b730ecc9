"""Where poses to evaluate come from: a module on the bus, or SLAM that runs over a sequence here and now."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import cv2
import numpy as np

from modules.slam.baseline import Baseline
from modules.slam.calibration import Rectifier
from modules.slam.geometry import quaternion
from modules.slam.sequences import recording
from modules.slam.slam import State, StereoSlam
from modules.slam.task import effort, picture, track
from modules.slam.trajectory import Trajectory, trajectory
from robotkit import MessageError, json_text

if TYPE_CHECKING:
    import threading
    from collections.abc import Callable
    from pathlib import Path

    import zenoh

    from modules.slam.geometry import Floats
    from modules.slam.sequences import Recording
    from robotkit.stereo import StereoFrame

    Located: TypeAlias = tuple[State, Floats, Floats | None]
    """The body's pose, and its covariance where there is one."""

POSE_KEY = "robot/slam/pose"


@dataclass
class Estimate:
    """Poses, and how many frames have none: lost, adrift, broken (not to be read) and dropped ones."""

    poses: list[tuple[int, list[float]]] = field(default_factory=list)
    lost: int = 0
    degraded: int = 0
    """Poses that count, though the module doubts them."""
    adrift: int = 0
    broken: int = 0
    dropped: int = 0
    cpu: list[float] = field(default_factory=list)
    """Seconds of CPU for each frame."""
    deviation: float | None = None
    """Standard deviation in metres of the last pose, in its worst direction; None where no covariance comes with it."""

    @property
    def frames(self) -> int:
        """How many frames there were, but for dropped ones."""
        return len(self.poses) + self.lost + self.adrift + self.broken

    @property
    def trajectory(self) -> Trajectory:
        """The poses in the order of their stamps."""
        return trajectory(self.poses)

    def hear(self, payload: bytes) -> None:
        """Take a pose message; one that is none is counted as broken."""
        try:
            message = json_text.loads(payload)
            values = [float(value) for value in (*message["position"], *message["orientation"])]
            stamp, timing = int(message["frame"]), message.get("timing") or {}
            state = State(message["state"])
            self.dropped = max(self.dropped, int(timing.get("dropped", 0)))
            self.cpu += [timing["cpu"] / 1e9] if "cpu" in timing else []
        except (ValueError, TypeError, KeyError, AttributeError):
            self.broken += 1
            return
        if len(values) != 7 or not all(map(math.isfinite, values)) or not any(values[3:]):
            self.broken += 1
        else:
            self.add(state, stamp, values)

    def add(self, state: State, stamp: int, values: list[float], deviation: float | None = None) -> None:
        """Take a pose (position, quaternion x, y, z, w) if the module knows it, else count it."""
        if state in (State.TRACKING, State.DEGRADED):
            self.poses.append((stamp, values))
            self.deviation = deviation
        self.degraded += state is State.DEGRADED
        self.lost += state is State.LOST
        self.adrift += state is State.ADRIFT


def listen(session: zenoh.Session, key: str, ended: threading.Event, seconds: float | None) -> Estimate:
    """The poses that a module publishes until `ended` is set or the time is over."""
    estimate = Estimate()
    subscriber = session.declare_subscriber(key, lambda sample: estimate.hear(sample.payload.to_bytes()))
    ended.wait(seconds)
    subscriber.undeclare()
    return estimate


def run(folder: Path, *, quality: float = 1.0, loops: bool = True) -> Estimate:
    """Run over a sequence with its own calibration, no frame dropped; without loops it is only odometry."""
    sequence = recording(folder)
    slam = StereoSlam(Rectifier(sequence.rig), effort(quality))

    def locate(frame: StereoFrame) -> Located:
        pose = track(slam, frame)
        if loops and not pose.is_keyframe:
            slam.close_loop()
        return pose.state, pose.world_from_body, pose.covariance

    return _over(sequence, locate)


def run_baseline(folder: Path) -> Estimate:
    """Run the baseline over a sequence."""
    sequence = recording(folder)
    rectifier = Rectifier(sequence.rig)
    baseline = Baseline(rectifier)

    def locate(frame: StereoFrame) -> Located:
        body = baseline.track(picture(frame.left, rectifier.size), picture(frame.right, rectifier.size))
        return (State.LOST, np.eye(4), None) if body is None else (State.TRACKING, body, None)

    return _over(sequence, locate)


def _deviation(covariance: Floats | None) -> float | None:
    return None if covariance is None else float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1]))


def _over(sequence: Recording, locate: Callable[[StereoFrame], Located]) -> Estimate:
    """Locate every frame, on one core, and measure what that takes."""
    cv2.setNumThreads(1)
    estimate = Estimate()
    for frame in sequence.frames:
        before = time.process_time()
        try:
            state, body, covariance = locate(frame)
        except MessageError:
            estimate.broken += 1
            continue
        estimate.cpu.append(time.process_time() - before)
        values = [*body[:3, 3].tolist(), *quaternion(body[:3, :3])]
        estimate.add(state, frame.stamp, values, _deviation(covariance))
    return estimate
