"""Where poses to evaluate come from: a module on the bus, or SLAM that runs over a sequence here and now."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import cv2

from modules.slam.calibration import Rectifier, load_rig
from modules.slam.geometry import quaternion
from modules.slam.slam import State, StereoSlam
from modules.slam.task import effort, track
from modules.slam.trajectory import Trajectory, trajectory
from robotkit import MessageError, euroc, json_text
from robotkit.stereo import encode

if TYPE_CHECKING:
    import threading
    from collections.abc import Iterator
    from pathlib import Path

    import zenoh

POSE_KEY = "robot/slam/pose"


@dataclass
class Estimate:
    """Poses, and how many frames have none that counts: lost, adrift, broken (not to be read) and dropped ones."""

    poses: list[tuple[int, list[float]]] = field(default_factory=list)
    lost: int = 0
    adrift: int = 0
    broken: int = 0
    dropped: int = 0
    cpu: list[float] = field(default_factory=list)
    """Seconds of CPU for each frame."""

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

    def add(self, state: State, stamp: int, values: list[float]) -> None:
        """Take a pose (position, quaternion x, y, z, w) if the module trusts it, else count it."""
        if state is State.TRACKING:
            self.poses.append((stamp, values))
        self.lost += state is State.LOST
        self.adrift += state is State.ADRIFT


def listen(session: zenoh.Session, key: str, ended: threading.Event, seconds: float | None) -> Estimate:
    """What a module says until `ended` is set or the time is over."""
    estimate = Estimate()
    subscriber = session.declare_subscriber(key, lambda sample: estimate.hear(sample.payload.to_bytes()))
    ended.wait(seconds)
    subscriber.undeclare()
    return estimate


def run(folder: Path, *, share: float | None = None, loops: bool = True) -> Estimate:
    """Run over a EuRoC sequence with its own calibration, no frame dropped; without loops it is only odometry."""
    cv2.setNumThreads(1)
    mav0 = euroc.find(folder)
    slam = StereoSlam(Rectifier(load_rig(mav0)), effort(share))
    estimate = Estimate()
    for payload in _frames(mav0):
        before = time.process_time()
        try:
            pose, stamp = track(slam, payload)
        except MessageError:
            estimate.broken += 1
            continue
        if loops and not pose.is_keyframe:
            slam.close_loop()
        estimate.cpu.append(time.process_time() - before)
        body = pose.world_from_body
        estimate.add(pose.state, stamp, [*body[:3, 3].tolist(), *quaternion(body[:3, :3])])
    return estimate


def _frames(mav0: Path) -> Iterator[bytes]:
    return (encode(frame) for frame in euroc.stereo(mav0))
