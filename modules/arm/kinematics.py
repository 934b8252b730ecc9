"""Where the gripper is for given joint angles, and the other way round.

The MeArm's rods keep the hand level and make the forearm's angle independent of the upper arm's: both are measured
against the horizontal. Lengths are in mm, angles in degrees. The origin is on the base's axis at the height of the
shoulder; x points ahead, y to the left, z up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

Point = tuple[float, float, float]


class Unreachable(ValueError):  # noqa: N818 - it reads as what it says
    """No joint angles bring the gripper there."""


@dataclass(frozen=True, slots=True)
class Links:
    """Lengths; `offset` is from the base's axis to the shoulder plus from the wrist to the grip."""

    upper_arm: float
    forearm: float
    offset: float


@dataclass(frozen=True, slots=True)
class Angles:
    """`base` is counter-clockwise from straight ahead, `shoulder` and `elbow` are the arms' slopes, upward positive."""

    base: float
    shoulder: float
    elbow: float


def forward(links: Links, angles: Angles) -> Point:
    """Return the place of the grip."""
    base, shoulder, elbow = map(math.radians, (angles.base, angles.shoulder, angles.elbow))
    reach = links.offset + links.upper_arm * math.cos(shoulder) + links.forearm * math.cos(elbow)
    height = links.upper_arm * math.sin(shoulder) + links.forearm * math.sin(elbow)
    return reach * math.cos(base), reach * math.sin(base), height


def inverse(links: Links, point: Point) -> Angles:
    """Return the joint angles, elbow up, that bring the grip to a point in front of the base, or raise Unreachable."""
    x, y, z = point
    reach = math.hypot(x, y) - links.offset
    distance = math.hypot(reach, z)
    nearest, farthest = abs(links.upper_arm - links.forearm), links.upper_arm + links.forearm
    if not nearest <= distance <= farthest or distance == 0:
        span = f"expected {nearest:g} to {farthest:g} mm"
        raise Unreachable(f"position {_text(point)}: {distance:.0f} mm from shoulder to wrist: {span}")
    slope = math.atan2(z, reach)
    shoulder = slope + _corner(links.upper_arm, distance, links.forearm)
    elbow = slope - _corner(links.forearm, distance, links.upper_arm)
    return Angles(math.degrees(math.atan2(y, x)), math.degrees(shoulder), math.degrees(elbow))


def _corner(side: float, other: float, opposite: float) -> float:
    """Return the angle between two sides of a triangle by the law of cosines."""
    cosine = (side**2 + other**2 - opposite**2) / (2 * side * other)
    return math.acos(min(max(cosine, -1.0), 1.0))


def _text(point: Point) -> str:
    return "({})".format(", ".join(f"{value:.0f}" for value in point))
