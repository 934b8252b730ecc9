"""The arm's configuration: its dimensions and limits, and what they mean for the servos."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import yaml

from modules.arm.kinematics import Angles, Links, Unreachable, forward, inverse
from robotkit import ConfigurationError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from modules.arm.kinematics import Point

NAMES = ("base", "shoulder", "elbow", "grip")
PULSES_US = (400, 2600)
"""The range that any hobby servo accepts."""
TOLERANCE = 1e-6
"""Rounding error allowed in an angle (degrees) or height (mm) exactly at its limit."""
FASTEST_DEG_S = 360
"""The MeArm's servos take half a second for half a turn."""

Posture = dict[str, float]
"""The angle in degrees of each of NAMES."""


@dataclass(frozen=True, slots=True)
class Joint:
    """`pulse` is in us at the two ends of `angle` (degrees), so a servo mounted in reverse has them swapped."""

    channel: int
    pulse: tuple[float, float]
    angle: tuple[float, float]
    speed: float

    def pulse_at(self, angle: float) -> float:
        """Return the pulse in us."""
        part = (angle - self.angle[0]) / (self.angle[1] - self.angle[0])
        return self.pulse[0] + part * (self.pulse[1] - self.pulse[0])

    def angle_at(self, pulse: float) -> float:
        """Return the angle in degrees."""
        part = (pulse - self.pulse[0]) / (self.pulse[1] - self.pulse[0])
        return self.angle[0] + part * (self.angle[1] - self.angle[0])

    @property
    def pulse_speed(self) -> float:
        """Return the top speed in us of pulse per second."""
        return self.speed * abs(self.pulse[1] - self.pulse[0]) / (self.angle[1] - self.angle[0])


@dataclass(frozen=True, slots=True)
class Arm:
    """Dimensions and limits: `lowest` and `home` in mm, `bend` in degrees between the arms."""

    links: Links
    joints: Mapping[str, Joint]
    lowest: float
    bend: tuple[float, float]
    home: Point

    def posture_at(self, point: Point, *, grip: float) -> Posture:
        """Return the posture that brings the grip to a point, or raise Unreachable with every limit in its way."""
        angles = inverse(self.links, point)
        return self.checked({"base": angles.base, "shoulder": angles.shoulder, "elbow": angles.elbow, "grip": grip})

    def checked(self, posture: Posture) -> Posture:
        """Return the posture back if it is allowed, or raise Unreachable with every limit that it breaks."""
        if problems := "; ".join(self._problems(posture)):
            raise Unreachable(problems)
        return posture

    def above_deck(self, posture: Posture) -> Posture:
        """Return the posture with its forearm raised until the grip is not below `lowest`."""
        if self.grip_at(posture)[2] >= self.lowest:
            return posture
        elbow_height = self.links.upper_arm * math.sin(math.radians(posture["shoulder"]))
        slope = math.asin(min((self.lowest - elbow_height) / self.links.forearm, 1.0))
        return {**posture, "elbow": math.degrees(slope)}

    def grip_at(self, posture: Posture) -> Point:
        """Return where the grip is."""
        return forward(self.links, Angles(posture["base"], posture["shoulder"], posture["elbow"]))

    def _problems(self, posture: Posture) -> Iterator[str]:
        for name in NAMES:
            least, most = self.joints[name].angle
            if not least - TOLERANCE <= posture[name] <= most + TOLERANCE:
                yield f"{name}: {posture[name]:.1f} degrees: expected {least:g} to {most:g}"
        bend = posture["shoulder"] - posture["elbow"]
        if not self.bend[0] - TOLERANCE <= bend <= self.bend[1] + TOLERANCE:
            yield f"bend: {bend:.1f} degrees between the arms: expected {self.bend[0]:g} to {self.bend[1]:g}"
        height = self.grip_at(posture)[2]
        if height < self.lowest - TOLERANCE:
            yield f"height: {height:.0f} mm: expected at least {self.lowest:g} mm"


def load_arm(path: Path) -> Arm:
    """Read a configuration such as arm.yaml, or raise ConfigurationError with all that is wrong."""
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigurationError(f"{path}: {error}") from error
    reader = _Reader(document)
    links = Links(*(reader.number(f"links_mm.{name}", 1, 1000) for name in ("upper_arm", "forearm", "offset")))
    joints = {name: _joint(reader, f"joints.{name}") for name in NAMES}
    lowest = reader.number("lowest_mm", -1000, 1000)
    bend = reader.numbers("bend_deg", 2, 0, 180)
    home = reader.numbers("home_mm", 3, -1000, 1000)
    reader.distinct({name: joint.channel for name, joint in joints.items()})
    if reader.problems:
        raise ConfigurationError(f"{path}: " + "; ".join(reader.problems))
    arm = Arm(links, joints, lowest, (bend[0], bend[1]), (home[0], home[1], home[2]))
    try:
        arm.posture_at(arm.home, grip=joints["grip"].angle[0])
    except Unreachable as error:
        raise ConfigurationError(f"{path}: home_mm: {error}") from error
    return arm


def _joint(reader: _Reader, field: str) -> Joint:
    pulse = reader.numbers(f"{field}.pulse_us", 2, *PULSES_US)
    angle = reader.numbers(f"{field}.angle_deg", 2, -180, 180)
    if pulse[0] == pulse[1] and not reader.problems:
        reader.problems.append(f"{field}.pulse_us: {pulse[0]:g} twice: expected two different pulses")
    if angle[0] >= angle[1] and not reader.problems:
        reader.problems.append(f"{field}.angle_deg: {angle[0]:g} to {angle[1]:g}: expected the smaller angle first")
    channel = int(reader.number(f"{field}.channel", 0, 23))
    return Joint(
        channel, (pulse[0], pulse[1]), (angle[0], angle[1]), reader.number(f"{field}.speed_deg_s", 1, FASTEST_DEG_S)
    )


class _Reader:
    """Reads fields and collects every problem instead of stopping at the first."""

    def __init__(self, document: object) -> None:
        self.problems: list[str] = []
        self._document = document

    def number(self, field: str, least: float, most: float) -> float:
        return self._checked(field, self._find(field), least, most)

    def numbers(self, field: str, count: int, least: float, most: float) -> list[float]:
        found = self._find(field)
        if not isinstance(found, list) or len(found) != count:
            self.problems.append(f"{field}: invalid value {found!r}: expected a list of {count} numbers")
            return [float(index) for index in range(count)]
        return [self._checked(field, value, least, most) for value in found]

    def distinct(self, channels: Mapping[str, int]) -> None:
        if len(set(channels.values())) < len(channels) and not self.problems:
            self.problems.append(f"channels: {channels}: expected a different one for each joint")

    def _find(self, field: str) -> object:
        found = self._document
        for part in field.split("."):
            found = found.get(part) if isinstance(found, dict) else None
        return found

    def _checked(self, field: str, value: object, least: float, most: float) -> float:
        number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        if not number or not least <= float(value) <= most:  # type: ignore[arg-type]
            self.problems.append(f"{field}: invalid value {value!r}: expected a number from {least:g} to {most:g}")
            return least
        return float(value)  # type: ignore[arg-type]
