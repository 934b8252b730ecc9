"""Moves in small steps, so that an arm whose controller is slow, suspended or dead stops by itself.

Each step is sent when it is due and is short enough to be safe on its own; the servos never have a target more than one
step away. A controller with little CPU moves the arm slowly, never blindly.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from modules.arm.joints import NAMES

if TYPE_CHECKING:
    from modules.arm.joints import Arm, Posture

STEP_S = 0.05
"""The time that one step takes at the joints' speeds."""


def stepped(arm: Arm, current: Posture, goal: Posture) -> Posture:
    """Return the next posture on the way: all joints arrive together, none moves faster than it may."""
    steps = max(abs(goal[name] - current[name]) / (arm.joints[name].speed * STEP_S) for name in NAMES)
    if steps <= 1:
        return dict(goal)
    return {name: current[name] + (goal[name] - current[name]) / steps for name in NAMES}
