"""Keyframes: the pictures that are kept, and when a new one is worth keeping."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from modules.slam.geometry import angle, inverse, moved

if TYPE_CHECKING:
    from modules.slam.features import Descriptors, Features, Indices, Mask
    from modules.slam.geometry import Floats

STEP_M, STEP_RAD = 0.05, np.radians(3)
"""A camera that moved less than both sees nothing new."""
HEAVIEST = 20.0
"""A landmark's weight after many sightings: it never gets so sure of itself that it can't be corrected."""


@dataclass
class Keyframe:
    """A kept picture: its features, and their places in the camera's frame (N x 3, NaN where unknown).

    A feature that no older keyframe had seen is a landmark that this keyframe owns: it moves along when the keyframe
    does. `weights` says how sure each place is, as sums of 1 / z^4: stereo errs with the square of the depth z. The
    segment is 0 in the map that began with the first picture, and higher where a lost camera started anew.
    """

    number: int
    segment: int
    world_from_camera: Floats
    features: Features
    points: Floats
    owned: Mask
    weights: Floats = field(init=False)

    def __post_init__(self) -> None:
        self.owned &= np.isfinite(self.points[:, 2])
        self.weights = self.points[:, 2] ** -4.0

    @property
    def known(self) -> Indices:
        """Features whose place is known."""
        return np.flatnonzero(np.isfinite(self.points[:, 2]))

    @property
    def landmarks(self) -> Indices:
        """Features that are landmarks of this keyframe."""
        return np.flatnonzero(self.owned)

    def descriptors(self, rows: Indices) -> Descriptors:
        """Descriptors of these features."""
        return self.features.descriptors[rows]

    def sharpen(self, rows: Indices, seen: Floats, weights: Floats) -> None:
        """Average landmarks' places with those seen anew, in this camera's frame, each by its weight."""
        before, more = self.weights[rows, None], weights[:, None]
        self.points[rows] = (before * self.points[rows] + more * seen) / (before + more)
        self.weights[rows] = np.minimum(before + more, HEAVIEST * more).ravel()


def shows_new(world_from_camera: Floats, last: Keyframe, *, inliers: int, expected: int, overlap: float) -> bool:
    """Whether a picture is worth keeping: its view moved, and it sees less than `overlap` of what is expected."""
    change = inverse(last.world_from_camera) @ world_from_camera
    return inliers < overlap * expected and (moved(change) > STEP_M or angle(change) > STEP_RAD)
