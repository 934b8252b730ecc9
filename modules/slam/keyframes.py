"""Keyframes: the pictures that are kept, and when a new one is worth keeping."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from modules.slam.geometry import angle, inverse, moved

if TYPE_CHECKING:
    from modules.slam.features import Descriptors, Features, View
    from modules.slam.geometry import Floats, Image

STEP_M, STEP_RAD = 0.05, np.radians(3)
"""A camera that moved less than both sees nothing new."""


@dataclass
class Keyframe:
    """A kept picture; features whose depth is known are its landmarks, and move along when it does.

    `points` are the landmarks' places in the camera's frame, N x 3 metres. The segment is 0 in the map that began with
    the first picture, and higher where a lost camera started over. The covariance is that of its pose, zero where
    the map begins; only the newest keyframes have their picture. `doubt` says why its landmarks may be wrong.
    """

    number: int
    segment: int
    world_from_camera: Floats
    features: Features
    points: Floats
    descriptors: Descriptors
    covariance: Floats = field(default_factory=lambda: np.zeros((6, 6)))
    image: Image | None = None
    doubt: str | None = None
    offset: float = 0.0
    """Pixels that disparities in its picture's middle were corrected by."""

    def __len__(self) -> int:
        """How many landmarks it has."""
        return len(self.points)


def make(number: int, segment: int, world_from_camera: Floats, view: View, points: Floats) -> Keyframe:
    """Make a keyframe of a view and the places of its features, NaN where unknown."""
    known = np.isfinite(points[:, 2])
    descriptors = view.features.descriptors[known]
    return Keyframe(number, segment, world_from_camera, view.features, points[known], descriptors, image=view.image)


def has_moved(world_from_camera: Floats, last: Keyframe) -> bool:
    """Whether a camera moved since a keyframe, so that it can see something new."""
    change = inverse(last.world_from_camera) @ world_from_camera
    return moved(change) > STEP_M or angle(change) > STEP_RAD
