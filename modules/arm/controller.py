"""Talks to the Maestro, which drives the arm's servos, over a serial line."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from modules.arm import servos
from modules.arm.joints import NAMES
from robotkit import DeviceError

if TYPE_CHECKING:
    from modules.arm.joints import Arm, Posture
    from robotkit.line import Line

ANSWER_S = 0.5


class Controller:
    """Sends postures as pulses; the Maestro enforces its speed limits on whatever is sent."""

    def __init__(self, line: Line, arm: Arm) -> None:
        self._line = line
        self._arm = arm

    def start(self) -> None:
        """Check that a Maestro answers, and set its speed limits; DeviceError if none does."""
        self.errors()
        for joint in self._arm.joints.values():
            self._line.write(servos.set_speed(joint.channel, joint.pulse_speed))

    def posture(self) -> Posture | None:
        """Return the posture last sent; None when no pulses are sent, so the servos' positions are unknown."""
        found: Posture = {}
        for name in NAMES:
            joint = self._arm.joints[name]
            pulse = self._ask(servos.get_position(joint.channel)) / servos.QUARTERS
            if not pulse:
                return None
            found[name] = joint.angle_at(pulse)
        return found

    def move(self, posture: Posture) -> None:
        """Send all servos their targets."""
        joints = self._arm.joints
        self._line.write(
            b"".join(servos.set_target(joints[name].channel, joints[name].pulse_at(posture[name])) for name in NAMES)
        )

    def relax(self) -> None:
        """Stop the pulses: the servos go limp."""
        self._line.write(b"".join(servos.set_target(joint.channel, 0) for joint in self._arm.joints.values()))

    def errors(self) -> int:
        """Return, and clear, the Maestro's error bits."""
        return self._ask(servos.GET_ERRORS)

    def _ask(self, command: bytes) -> int:
        while self._line.read(0):  # noise, or the late answer to an earlier command
            pass
        self._line.write(command)
        heard, deadline = b"", time.monotonic() + ANSWER_S
        while (left := deadline - time.monotonic()) > 0:
            heard += self._line.read(left)
            if len(heard) >= 2:
                return int.from_bytes(heard[:2], "little")
        raise DeviceError(f"{self._line.name}: no answer to {command.hex(' ')} in {ANSWER_S:g} s: expected a Maestro")
