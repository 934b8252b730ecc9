"""How uncertain poses are: 6 x 6 covariances of a small shift, then turn, in the axes of what is there (m2, rad2)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from modules.slam.geometry import inverse

if TYPE_CHECKING:
    from modules.slam.geometry import Floats

FAR_M, ANY_RAD = 1000.0, np.pi
"""Standard deviations of a pose of which nothing is known."""


def anywhere() -> Floats:
    """The covariance of a pose of which nothing is known."""
    return np.diag(np.repeat([FAR_M, ANY_RAD], 3) ** 2)


def carried(covariance: Floats, target_from_source: Floats) -> Floats:
    """The covariance of something that is fixed to what a covariance is known of, in its own axes.

    `target_from_source` leads from the axes of what is known to the axes of the other.
    """
    rotation, (x, y, z) = target_from_source[:3, :3], target_from_source[:3, 3]
    adjoint = np.zeros((6, 6))
    adjoint[:3, :3] = adjoint[3:, 3:] = rotation
    adjoint[:3, 3:] = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ rotation
    moved: Floats = adjoint @ covariance @ adjoint.T
    return moved


def chained(first: Floats, second: Floats, first_from_second: Floats) -> Floats:
    """The covariance of a pose that is seen from another: its own, and that of what it is seen from."""
    return carried(first, inverse(first_from_second)) + second


def stretched(covariance: Floats, position: Floats, spread: float) -> Floats:
    """Of a place this far from where the map begins, if the scale of all distances is uncertain (a part of 1)."""
    wider: Floats = covariance.copy()
    wider[:3, :3] += spread**2 * np.outer(position, position)
    return wider


def turned(covariance: Floats, world_from_body: Floats) -> Floats:
    """In the world's axes, as ROS has it: of x, y, z and the turns about these axes, at the body's place."""
    rotation = np.zeros((6, 6))
    rotation[:3, :3] = rotation[3:, 3:] = world_from_body[:3, :3]
    upright: Floats = rotation @ covariance @ rotation.T
    return upright
