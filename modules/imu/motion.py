"""Standing still, moving or turning, from an IMU alone: no wheels, no ground truth.

A window of the last samples is still when neither rates nor accelerations vary more than a standing robot's do
(angular-rate-energy and acceleration-variance detectors, I. Skog et al., "Zero-velocity detection: an algorithm
evaluation", IEEE TBME 2010), and when the mean rate is that of standing, which is the gyroscope's bias. Turning is the
mean rate about the vertical, which is where gravity points. An IMU can't feel a constant speed: what sets a rolling
robot apart from a standing one is that real wheels shake it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from robotkit.readings import ImuSample

    Floats = NDArray[np.float64]

WINDOW_NS = 250_000_000
FEWEST = 8
"""Samples that a window needs before it says anything."""
GAP_NS = 100_000_000
"""After a gap this long, earlier samples say nothing about the present."""
SETTLED_NS = 250_000_000
"""A robot counts as still once every window has been still for this long; it counts as moving at once."""


class State(StrEnum):
    """What the robot does; turning is moving too."""

    STILL = "still"
    MOVING = "moving"
    TURNING = "turning"


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Limits of a standing robot: standard deviations in rad/s and m/s2, and its mean `rate` in rad/s.

    Above `turn` rad/s it is turning; `bias` is the largest rate, in rad/s, that a gyroscope at rest may show.
    """

    gyro: float = 0.015
    accel: float = 0.12
    rate: float = 0.02
    turn: float = 0.1
    bias: float = 0.1


@dataclass(frozen=True, slots=True)
class Motion:
    """What the robot does, and its rate about the vertical in rad/s, left is positive."""

    state: State
    rate: float


class MotionDetector:
    """Classifies the robot's motion at each sample."""

    def __init__(self) -> None:
        self._limits = Thresholds()
        self._window: deque[tuple[int, tuple[float, ...]]] = deque()
        self._bias: Floats | None = None
        self._shaken: int | None = None

    def feed(self, sample: ImuSample) -> Motion | None:
        """Take a sample; returns None until there are enough samples. A gap, or a clock that goes back, starts over."""
        if self._window and not 0 <= sample.stamp - self._window[-1][0] <= GAP_NS:
            self._window.clear()
        self._window.append((sample.stamp, sample.gyro + sample.accel))
        while sample.stamp - self._window[0][0] > WINDOW_NS:
            self._window.popleft()
        return self._motion() if len(self._window) >= FEWEST else None

    def _motion(self) -> Motion:
        now, values = self._window[-1][0], np.array([values for _, values in self._window])
        mean, spread = values.mean(axis=0), values.std(axis=0)
        calm = self._is_calm(mean, spread)
        if calm:
            self._learn(mean[:3])
        else:
            self._shaken = now
        rate = self._rate(mean)
        if calm and (self._shaken is None or now - self._shaken >= SETTLED_NS):
            return Motion(State.STILL, rate)
        return Motion(State.TURNING if abs(rate) > self._limits.turn else State.MOVING, rate)

    def _is_calm(self, mean: Floats, spread: Floats) -> bool:
        if np.linalg.norm(spread[:3]) > self._limits.gyro or np.linalg.norm(spread[3:]) > self._limits.accel:
            return False
        if self._bias is None:  # the first calm window gives the bias: a robot stands when it is switched on
            return bool(np.linalg.norm(mean[:3]) < self._limits.bias)
        return bool(np.linalg.norm(mean[:3] - self._bias) < self._limits.rate)

    def _learn(self, rates: Floats) -> None:
        """Follow the bias slowly: it drifts with temperature."""
        self._bias = rates if self._bias is None else self._bias + 0.01 * (rates - self._bias)

    def _rate(self, mean: Floats) -> float:
        up = mean[3:] / max(float(np.linalg.norm(mean[3:])), 1e-9)
        bias = 0.0 if self._bias is None else self._bias
        return float((mean[:3] - bias) @ up)
