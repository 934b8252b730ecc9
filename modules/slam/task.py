"""From a stereo frame to a pose: locate, then use the time that is left to close loops."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from modules.slam.geometry import quaternion
from modules.slam.slam import Effort
from robotkit import MessageError, Result, Task
from robotkit.readings import decoded, taken_at
from robotkit.stereo import decode

if TYPE_CHECKING:
    from collections.abc import Callable

    from modules.slam.geometry import Floats, Image
    from modules.slam.slam import Pose, StereoSlam
    from robotkit import Received
    from robotkit.stereo import StereoFrame

FEWEST_FEATURES, MOST_FEATURES = 450, 800
LEAST_OVERLAP, MOST_OVERLAP = 0.2, 0.75


class Slam(Task):
    """Follows the robot and maps its surroundings; at a lower quality it does less for a picture, and keeps up."""

    def __init__(self, slam: StereoSlam, now: Callable[[], int] = time.time_ns) -> None:
        self._slam = slam
        self._now = now
        self._finished = 0

    def set_quality(self, quality: float) -> None:
        """Match the work to the time that there is."""
        self._slam.effort = effort(quality)

    def process(self, received: Received) -> list[Result]:
        """Give the pose of the body in the frame of the first picture, with the stamp of its own picture."""
        in_time = received.received >= self._finished
        frame = decode(received.payload)
        pose = track(self._slam, frame)
        if in_time and not pose.is_keyframe:  # else other pictures wait, or a keyframe has taken the time already
            self._slam.close_loop()
        self._finished = self._now()
        return [Result("pose", self._content(frame, pose), taken_at(frame.stamp, received))]

    def _content(self, frame: StereoFrame, pose: Pose) -> dict[str, object]:
        return {
            "frame": frame.stamp,
            "position": pose.world_from_body[:3, 3].tolist(),
            "orientation": quaternion(pose.world_from_body[:3, :3]),
            "inliers": pose.inliers,
            "state": pose.state.value,
            "doubt": pose.doubt,
            "covariance": None if pose.covariance is None else _rounded(pose.covariance),
            "keyframes": len(self._slam.map.keyframes),
            "landmarks": self._slam.map.landmarks,
            "loops": self._slam.loops.closed,
        }


def effort(quality: float | None) -> Effort:
    """The work of a quality from 0 to 1: at 1, or where none is set, all features and frequent keyframes."""
    part = 1.0 if quality is None else min(quality, 1.0)
    return Effort(
        features=round(FEWEST_FEATURES + part * (MOST_FEATURES - FEWEST_FEATURES)),
        overlap=LEAST_OVERLAP + part * (MOST_OVERLAP - LEAST_OVERLAP),
    )


def track(slam: StereoSlam, frame: StereoFrame) -> Pose:
    """Locate a stereo frame; MessageError if its pictures can't be read."""
    return slam.track(picture(frame.left, slam.size), lambda: picture(frame.right, slam.size))


def picture(encoded: bytes, size: tuple[int, int]) -> Image:
    """Decode a picture of the calibration's size; MessageError if it is none."""
    image = decoded(encoded, gray=True)
    height, width = image.shape
    if (width, height) != size:
        raise MessageError(
            f"a picture of {width} x {height} pixels: expected {size[0]} x {size[1]}, as in the calibration"
        )
    return image


def _rounded(covariance: Floats) -> list[float]:
    """Row by row, as ROS has it; the fourth digit of an uncertainty means nothing."""
    return [float(f"{value:.3g}") for value in covariance.ravel()]
