"""How the robot of a generated recording moves: it stands, rolls along a corridor or a course, and stands again."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

GRAVITY = np.array([0.0, 0.0, 9.81])
RAMP = 0.5
STEP = 0.001


@dataclass(frozen=True)
class Motion:
    """A planar path with the sway of wheels; `moving` lists intervals in seconds.

    `course` is where it heads: metres to roll and radians to turn left meanwhile, piece by piece; straight on after the
    last one.
    """

    duration: float
    moving: tuple[tuple[float, float], ...]
    speed: float = 0.3
    course: tuple[tuple[float, float], ...] = ()

    def speed_at(self, times: Floats) -> Floats:
        """Forward speed in m/s; it ramps up and down within each interval."""
        ramps = [np.clip(np.minimum(times - start, end - times) / RAMP, 0, 1) for start, end in self.moving]
        smooth = [3 * ramp**2 - 2 * ramp**3 for ramp in ramps]
        total: Floats = self.speed * np.sum([np.zeros_like(times), *smooth], axis=0)
        return total

    def angles_at(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """Yaw, pitch and roll in radians; none changes while the robot stands."""
        pace = self.speed_at(times) / self.speed
        sway = 0.12 * np.sin(1.1 * times) + 0.04 * np.sin(2.7 * times)
        pitch, roll = 0.008 * np.sin(11.0 * times), 0.006 * np.sin(8.3 * times + 1)
        return self._headings_at(times) + pace * sway, pace * pitch, pace * roll

    def rotations_at(self, times: Floats) -> Floats:
        """World-from-body rotations, N x 3 x 3."""
        yaw, pitch, roll = self.angles_at(times)
        return _turn(2, yaw) @ _turn(1, pitch) @ _turn(0, roll)

    def positions_at(self, times: Floats) -> Floats:
        """Positions in metres, N x 3."""
        grid, path = self._path
        return np.column_stack([np.interp(times, grid, path[:, axis]) for axis in range(3)])

    def velocities_at(self, times: Floats) -> Floats:
        """World velocities in m/s, N x 3: the robot goes where it looks."""
        yaw = self.angles_at(times)[0]
        speed = self.speed_at(times)
        return np.column_stack([speed * np.cos(yaw), speed * np.sin(yaw), np.zeros_like(yaw)])

    def gyro_at(self, times: Floats) -> Floats:
        """Angular rates in the body's frame, N x 3 rad/s."""
        before, after = self.rotations_at(times - STEP), self.rotations_at(times + STEP)
        change = np.swapaxes(before, 1, 2) @ after / (2 * STEP)
        return np.column_stack([change[:, 2, 1], change[:, 0, 2], change[:, 1, 0]])

    def accelerations_at(self, times: Floats) -> Floats:
        """What an accelerometer feels in the body's frame, N x 3 m/s2, gravity included."""
        change = (self.velocities_at(times + STEP) - self.velocities_at(times - STEP)) / (2 * STEP)
        felt: Floats = np.einsum("nij,ni->nj", self.rotations_at(times), change + GRAVITY)
        return felt

    def _headings_at(self, times: Floats) -> Floats:
        """Where the course leads, as yaw in radians."""
        metres, turns = np.cumsum([(0.0, 0.0), *self.course], axis=0).T
        grid, rolled = self._rolled
        headings: Floats = np.interp(np.interp(times, grid, rolled), metres, turns)
        return headings

    @cached_property
    def _rolled(self) -> tuple[Floats, Floats]:
        """A grid of times, and the metres rolled by then."""
        grid = np.arange(0.0, self.duration + STEP, STEP)
        return grid, _integrated(self.speed_at(grid))

    @cached_property
    def _path(self) -> tuple[Floats, Floats]:
        grid = np.arange(0.0, self.duration + STEP, STEP)
        return grid, _integrated(self.velocities_at(grid))


def _integrated(rates: Floats) -> Floats:
    """Sums from zero of what changes at these rates, by the trapezoidal rule."""
    steps = (rates[1:] + rates[:-1]) / 2 * STEP
    sums: Floats = np.concatenate([np.zeros_like(rates[:1]), np.cumsum(steps, axis=0)])
    return sums


def _turn(axis: int, angles: Floats) -> Floats:
    """Rotations about one axis, N x 3 x 3."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrices = np.tile(np.eye(3), (len(angles), 1, 1))
    matrices[:, first, first] = matrices[:, second, second] = np.cos(angles)
    matrices[:, second, first] = np.sin(angles)
    matrices[:, first, second] = -np.sin(angles)
    return matrices
