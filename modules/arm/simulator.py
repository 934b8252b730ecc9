"""`python -m modules.arm.simulator`: a Pololu Maestro with four servos, as its user's guide describes it.

A pulse follows its target at the channel's speed limit, or at once without one; a servo follows its pulse at its own
speed. A channel that sends no pulse knows no position. Errors are kept until they are asked for.
"""

from __future__ import annotations

import math

from modules.arm.servos import Command, CommandParser, Opcode
from robotkit.simulated import main

CHANNELS = 6
SERVO_US_PER_S = 1900 / 0.5
"""A MeArm's servo takes half a second for half a turn."""
TICKS_PER_S = 100
"""Speed limits are in units per 10 ms."""


class Maestro:
    """The controller behind its serial port; `servos` is where the servos really are, in us."""

    period = 0.01

    def __init__(self) -> None:
        self.targets = [0] * CHANNELS
        self.pulses = [0.0] * CHANNELS
        self.speeds = [0] * CHANNELS
        self.servos = [1500.0] * CHANNELS
        self._parser = CommandParser()

    def receive(self, data: bytes) -> bytes:
        """Carry out the commands that are complete."""
        return b"".join(self._obey(command) for command in self._parser.feed(data))

    def advance(self, seconds: float) -> bytes:
        """Let pulses follow targets, and servos pulses."""
        for channel in range(CHANNELS):
            speed = self.speeds[channel]
            limit = speed * TICKS_PER_S * seconds if speed else math.inf
            pulse = self.pulses[channel] = _towards(self.pulses[channel], self.targets[channel], limit)
            if pulse:
                self.servos[channel] = _towards(self.servos[channel], pulse / 4, SERVO_US_PER_S * seconds)
        return b""

    def _obey(self, command: Command) -> bytes:
        if command.channel >= CHANNELS:
            return b""
        match command.opcode:
            case Opcode.SET_TARGET:
                self._aim(command.channel, command.value)
            case Opcode.SET_SPEED:
                self.speeds[command.channel] = command.value
            case Opcode.GO_HOME:
                self.targets, self.pulses = [0] * CHANNELS, [0.0] * CHANNELS
            case Opcode.GET_POSITION:
                return round(self.pulses[command.channel]).to_bytes(2, "little")
            case Opcode.GET_ERRORS:
                return self._parser.take_errors().to_bytes(2, "little")
        return b""

    def _aim(self, channel: int, target: int) -> None:
        if not target or not self.pulses[channel] or not self.speeds[channel]:
            self.pulses[channel] = float(target)
        self.targets[channel] = target


def _towards(value: float, goal: float, most: float) -> float:
    return goal if abs(goal - value) <= most else value + (most if goal > value else -most)


if __name__ == "__main__":
    main(Maestro(), "Pololu Maestro with a MeArm")
