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
PARTS = tuple(0.5**halvings for halvings in range(9))
"""Of a step, the greatest first."""


def stepped(arm: Arm, current: Posture, goal: Posture) -> Posture:
    """Return the next posture on the way: no joint moves faster than it may, and all arrive together.

    Half way between two postures the grip may be lower than at both, and so below the deck. There the forearm is
    raised; where it would have to rise faster than it may, all joints take a smaller step.
    """
    steps = max(abs(goal[name] - current[name]) / (arm.joints[name].speed * STEP_S) for name in NAMES)
    if steps <= 1:
        return dict(goal)
    rise = arm.joints["elbow"].speed * STEP_S
    for part in PARTS:
        step = {name: current[name] + (goal[name] - current[name]) * part / steps for name in NAMES}
        raised = arm.above_deck(step)
        if raised["elbow"] - current["elbow"] <= rise:
            return raised
    return {**current, "elbow": current["elbow"] + rise}  # it was left below the deck: up first
