"""The camera that explains best where a keyframe's landmarks are seen, and how sure that is.

A landmark is a ray of the keyframe and its disparity. Both it and the pixels where it is seen have noise, so the pose
and the disparities are fitted together (bundle adjustment of two views). The noise of a disparity is the same for all
landmarks in pixels, so the depth of a far one is uncertain by as much as the depth itself: it says much of how the
camera turned, and little of how far it went. Landmarks that don't fit lose their weight (Cauchy).

Landmarks are tied to each other only through the pose: each is eliminated (Schur complement), and six unknowns remain.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from modules.slam.geometry import floats, inverse, twist

if TYPE_CHECKING:
    from modules.slam.calibration import Rectifier
    from modules.slam.features import Mask
    from modules.slam.geometry import Floats

PIXEL_NOISE, DISPARITY_NOISE = 0.4, 0.2
"""Standard deviations in pixels of where optical flow sees a landmark, and of its disparity."""
OUTLIER, CAUCHY = 3.5, 2.0
"""Standard deviations at which a landmark counts as somewhere else, and at which it has lost half of its weight."""
OFFSET_NOISE = 0.5
"""Pixels (standard deviation) by which calibrations are wrong: the right camera turned by 0.04 degrees. KITTI's are
(Cvišić et al., Recalibrating the KITTI dataset camera setup for improved odometry accuracy, ECMR 2021)."""
LEAST_SPREAD = 0.03
"""Pixels (standard deviation) below which the offset of disparities is never taken for known."""
FADING = 0.7
"""The part that is left, a keyframe later, of what the offset moved by."""
ROUNDS, ENOUGH = 5, 1e-3
MIN_DEPTH, MIN_DISPARITY = 1e-3, 1e-3


@dataclass(frozen=True)
class Offset:
    """Pixels by which disparities in the picture's middle are too large: the right camera is turned sideways."""

    pixels: float = 0.0
    spread: float = OFFSET_NOISE
    """Standard deviation, if all that is wrong is noise and the offset."""
    moved: float = 0.0
    """Pixels by which it moved from keyframe to keyframe, lately."""

    def learned(self, found: Offset) -> Offset:
        """What is known after one more keyframe."""
        moved = max(FADING * self.moved, abs(found.pixels - self.pixels))
        return Offset(found.pixels, max(found.spread, LEAST_SPREAD), moved)

    def forgotten(self) -> Offset:
        """What is known when the right camera may have moved."""
        return Offset(self.pixels, moved=self.moved)


def turn_shifts(matrix: Floats, pixels: Floats) -> Floats:
    """How many times as far as in the picture's middle a sideways turn of the camera shifts what is seen there.

    Columns are focal * tan(angle), whose derivative is focal * (1 + tan(angle)^2).
    """
    shifts: Floats = 1 + ((pixels[:, 0] - matrix[0, 2]) / matrix[0, 0]) ** 2
    return shifts


@dataclass(frozen=True)
class Sightings:
    """N landmarks of a keyframe: pixels and disparities there, pixels in the picture, disparities there or NaN."""

    pixels: Floats
    disparities: Floats
    seen: Floats
    seen_disparities: Floats
    noise: float = PIXEL_NOISE
    """Standard deviation in pixels of where they are seen."""
    offset: Offset = Offset()


@dataclass(frozen=True)
class Fitted:
    """A pose, its covariance (shift, then turn, in the camera's axes), which landmarks fit, and how well those do.

    `misfit` is the root mean square of what remains, in standard deviations: about 1 where the noise is as expected.
    """

    keyframe_from_camera: Floats
    covariance: Floats
    fits: Mask
    misfit: float
    offset: Offset


class Refiner:
    """Fits poses of a camera with this calibration."""

    def __init__(self, rectifier: Rectifier) -> None:
        self._matrix: Floats = rectifier.matrix
        self._focal = float(rectifier.matrix[0, 0])
        self._centre: Floats = rectifier.matrix[:2, 2]
        self._baseline = rectifier.baseline

    def fit(self, sightings: Sightings, keyframe_from_camera: Floats) -> Fitted:
        """Start from a pose that is roughly right."""
        pose, offset = inverse(keyframe_from_camera), sightings.offset.pixels
        disparities = np.maximum(sightings.disparities - offset * self._shifts(sightings.pixels), MIN_DISPARITY)
        for _ in range(ROUNDS):
            step, changes, _ = self._linearised(sightings, pose, disparities, offset).solved()
            pose, offset = twist(step[:6]) @ pose, offset + step[6]
            disparities = np.maximum(disparities + changes, MIN_DISPARITY)
            if np.abs(step[:6]).max() < ENOUGH:
                break
        system = self._linearised(sightings, pose, disparities, offset)
        fits = system.distances < OUTLIER
        # A landmark's own disparity takes one of its measures away.
        freedom = (2 + np.isfinite(sightings.seen_disparities[fits])).sum()
        misfit = float(np.sqrt((system.distances[fits] ** 2).sum() / freedom)) if fits.any() else np.inf
        covariance = floats(np.linalg.pinv(system.solved()[2], hermitian=True)) * max(1.0, misfit**2)
        found = Offset(float(offset), float(np.sqrt(covariance[6, 6])), sightings.offset.moved)
        return Fitted(inverse(pose), covariance[:6, :6], fits, misfit, found)

    def _linearised(self, sightings: Sightings, pose: Floats, disparities: Floats, offset: float) -> _System:
        """Residuals and their derivatives, in standard deviations; points are scaled by their inverse depth."""
        inverse_depths = disparities / (self._focal * self._baseline)
        rays = np.column_stack([(sightings.pixels - self._centre) / self._focal, np.ones(len(disparities))])
        shifts, shifts_there = self._shifts(sightings.pixels), self._shifts(sightings.seen)
        points = rays @ pose[:3, :3].T + inverse_depths[:, None] * pose[:3, 3]
        depths = np.maximum(points[:, 2], MIN_DEPTH)
        x, y = points[:, 0] / depths, points[:, 1] / depths
        there = disparities / depths
        predicted = np.column_stack(
            [self._focal * x + self._centre[0], self._focal * y + self._centre[1], there + offset * shifts_there]
        )
        rest = np.column_stack([sightings.seen, sightings.seen_disparities]) - predicted
        known = np.isfinite(rest)
        scale = known / np.array([sightings.noise, sightings.noise, DISPARITY_NOISE])
        by_pose = self._by_pose(x, y, there, inverse_depths / depths, shifts_there)
        by_disparity = self._by_disparity(x, y, there, depths, pose[:3, 3])
        prior = (sightings.disparities - offset * shifts - disparities) / DISPARITY_NOISE
        about = (sightings.offset.pixels - offset) / sightings.offset.spread, sightings.offset.spread
        return _System(
            np.where(known, rest, 0) * scale, by_pose * scale[:, :, None], by_disparity * scale, prior, shifts, about
        )

    def _shifts(self, pixels: Floats) -> Floats:
        return turn_shifts(self._matrix, pixels)

    def _by_pose(self, x: Floats, y: Floats, there: Floats, near: Floats, shifts: Floats) -> Floats:
        """Derivatives of column, row and disparity by shift, turn and offset, N x 3 x 7; `near` is 1 / depth."""
        focal, none = self._focal, np.zeros_like(x)
        rows = [
            [focal * near, none, -focal * near * x, -focal * x * y, focal * (1 + x * x), -focal * y, none],
            [none, focal * near, -focal * near * y, -focal * (1 + y * y), focal * x * y, focal * x, none],
            [none, none, -there * near, -there * y, there * x, none, shifts],
        ]
        return np.ascontiguousarray(np.moveaxis(np.array(rows), -1, 0))

    def _by_disparity(self, x: Floats, y: Floats, there: Floats, depths: Floats, shift: Floats) -> Floats:
        """Derivatives of the same by the landmark's disparity in the keyframe, N x 3."""
        across, down, ahead = shift / self._baseline
        pixels = [(across - x * ahead) / depths, (down - y * ahead) / depths]
        return np.column_stack([*pixels, (1 - there * ahead / self._focal) / depths])


@dataclass(frozen=True)
class _System:
    """N landmarks: what remains, N x 3; its derivatives by the pose and by their disparities; and the prior's.

    `shifts` are the derivatives of the disparities in the keyframe by the offset.
    """

    rest: Floats
    by_pose: Floats
    by_disparity: Floats
    prior: Floats
    shifts: Floats
    offset: tuple[float, float]

    @property
    def distances(self) -> Floats:
        """How far each landmark is from where it should be, in standard deviations."""
        distances: Floats = np.sqrt((self.rest**2).sum(axis=1) + self.prior**2)
        return distances

    def solved(self) -> tuple[Floats, Floats, Floats]:
        """The step of the pose, those of the disparities, and the information (inverse covariance) of the pose."""
        weights = 1 / (1 + (self.distances / CAUCHY) ** 2)
        by_offset = np.outer(self.shifts, np.eye(7)[6]) / DISPARITY_NOISE
        own = (self.by_disparity**2).sum(axis=1) + DISPARITY_NOISE**-2
        pull = (self.by_disparity * self.rest).sum(axis=1) + self.prior / DISPARITY_NOISE
        mixed = np.einsum("nij,ni->nj", self.by_pose, self.by_disparity) + by_offset / DISPARITY_NOISE
        weighted = (self.by_pose * weights[:, None, None]).reshape(-1, 7)
        information = weighted.T @ self.by_pose.reshape(-1, 7) - (mixed * (weights / own)[:, None]).T @ mixed
        gradient = weighted.T @ self.rest.ravel() - mixed.T @ (weights * pull / own)
        information[6, 6] += (weights * self.shifts**2).sum() / DISPARITY_NOISE**2 + self.offset[1] ** -2
        gradient[6] += weights * self.prior @ self.shifts / DISPARITY_NOISE + self.offset[0] / self.offset[1]
        step = np.linalg.lstsq(information, gradient, rcond=None)[0]
        return step, (pull - mixed @ step) / own, information
