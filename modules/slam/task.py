"""From a stereo frame to a pose: locate, then use the time that is left to close loops."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from modules.slam.geometry import quaternion
from modules.slam.slam import Effort
from robotkit import MessageError, Task
from robotkit.readings import decoded
from robotkit.stereo import decode

if TYPE_CHECKING:
    from collections.abc import Callable

    from modules.slam.geometry import Image
    from modules.slam.slam import StereoSlam
    from robotkit import Decision, Received

FEWEST_FEATURES, MOST_FEATURES = 300, 800
LEAST_OVERLAP, MOST_OVERLAP = 0.35, 0.5


class Slam(Task):
    """Follows the robot and maps its surroundings; with a smaller share it does less for a picture, and keeps up."""

    def __init__(self, slam: StereoSlam, now: Callable[[], int] = time.time_ns) -> None:
        self._slam = slam
        self._now = now
        self._finished = 0

    def adapt(self, decision: Decision) -> None:
        """Match the work to the share: one core pays for all features and frequent keyframes."""
        share = min(1.0 if decision.share is None else decision.share, 1.0)
        self._slam.effort = Effort(
            features=round(max(share * MOST_FEATURES, FEWEST_FEATURES)),
            overlap=LEAST_OVERLAP + share * (MOST_OVERLAP - LEAST_OVERLAP),
        )

    def process(self, received: Received) -> dict[str, object]:
        """Give the pose of the body in the frame of the first picture, with the picture's stamp."""
        in_time = received.received >= self._finished
        frame = decode(received.payload)
        pose = self._slam.track(self._picture(frame.left), lambda: self._picture(frame.right))
        if in_time and not pose.is_keyframe:
            self._slam.close_loop()
        self._finished = self._now()
        return {
            "frame": frame.stamp,
            "position": pose.world_from_body[:3, 3].tolist(),
            "orientation": quaternion(pose.world_from_body[:3, :3]),
            "inliers": pose.inliers,
            "state": pose.state.value,
            "keyframes": len(self._slam.map.keyframes),
            "landmarks": self._slam.map.landmarks,
            "loops": self._slam.loops.closed,
        }

    def _picture(self, encoded: bytes) -> Image:
        picture = decoded(encoded, gray=True)
        width, height = self._slam.size
        if picture.shape != (height, width):
            raise MessageError(f"a picture of {picture.shape[1]} x {picture.shape[0]}: the cameras have {width} x {height}")
        return picture
