"""From a stereo frame to a pose."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from modules.slam.geometry import quaternion
from robotkit import MessageError, Task
from robotkit.stereo import decode

if TYPE_CHECKING:
    from modules.slam.geometry import Image
    from modules.slam.odometry import Odometry
    from robotkit import Decision, Received

FEWEST_FEATURES, MOST_FEATURES = 300, 800


class Slam(Task):
    """Follows the robot; with a smaller share it looks at fewer features, so that it keeps up."""

    def __init__(self, odometry: Odometry) -> None:
        self._odometry = odometry

    def adapt(self, decision: Decision) -> None:
        """Match the work to the share: one core pays for all features."""
        share = 1.0 if decision.share is None else decision.share
        self._odometry.features = round(min(max(share * MOST_FEATURES, FEWEST_FEATURES), MOST_FEATURES))

    def process(self, received: Received) -> dict[str, object]:
        """Give the pose of the body in the frame of the first picture, with the picture's stamp."""
        frame = decode(received.payload)
        pose = self._odometry.track(_picture(frame.left), _picture(frame.right))
        return {
            "frame": frame.stamp,
            "position": pose.world_from_body[:3, 3].tolist(),
            "orientation": quaternion(pose.world_from_body[:3, :3]),
            "inliers": pose.inliers,
        }


def _picture(encoded: bytes) -> Image:
    picture = cv2.imdecode(np.frombuffer(encoded, np.uint8), cv2.IMREAD_GRAYSCALE) if encoded else None
    if picture is None:
        raise MessageError("a picture of the stereo frame cannot be decoded")
    return picture.astype(np.uint8, copy=False)
