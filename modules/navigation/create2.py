"""Talks to the Create 2 over a serial line: commands out, sensor frames in."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from modules.navigation import open_interface as oi
from modules.navigation import packets
from modules.navigation.packets import StreamParser

if TYPE_CHECKING:
    from collections.abc import Mapping

    from robotkit.line import Line

CLIFFS = (packets.CLIFF_LEFT, packets.CLIFF_FRONT_LEFT, packets.CLIFF_FRONT_RIGHT, packets.CLIFF_RIGHT)
STREAMED = (
    packets.BUMPS_AND_DROPS,
    *CLIFFS,
    packets.CHARGING_STATE,
    packets.VOLTAGE,
    packets.CURRENT,
    packets.CHARGE,
    packets.CAPACITY,
    packets.OI_MODE,
    packets.LEFT_ENCODER,
    packets.RIGHT_ENCODER,
)
MODES = {packets.OFF: "off", packets.PASSIVE: "passive", packets.SAFE_MODE: "safe", packets.FULL_MODE: "full"}


class Sensors(NamedTuple):
    """One frame: counts of the wheels, what is wrong around the robot, mA, mV, charge from 0 to 1."""

    left: int
    right: int
    bumped: bool
    lifted: bool
    cliff: bool
    mode: int
    charging: bool
    voltage: int
    current: int
    battery: float | None


def read_sensors(values: Mapping[int, int]) -> Sensors:
    """Decode a frame of STREAMED."""
    contacts, capacity = values[packets.BUMPS_AND_DROPS], values[packets.CAPACITY]
    return Sensors(
        left=values[packets.LEFT_ENCODER],
        right=values[packets.RIGHT_ENCODER],
        bumped=bool(contacts & (packets.BUMP_LEFT | packets.BUMP_RIGHT)),
        lifted=bool(contacts & (packets.DROP_LEFT | packets.DROP_RIGHT)),
        cliff=any(values[cliff] for cliff in CLIFFS),
        mode=values[packets.OI_MODE],
        charging=values[packets.CHARGING_STATE] in range(1, 5),
        voltage=values[packets.VOLTAGE],
        current=values[packets.CURRENT],
        battery=values[packets.CHARGE] / capacity if capacity else None,
    )


class Create2:
    """Commands go out at once, whole and in one write, so any thread may stop the robot."""

    def __init__(self, line: Line) -> None:
        self._line = line
        self._parser = StreamParser(STREAMED)

    @property
    def skipped(self) -> int:
        """Bytes that belonged to no frame."""
        return self._parser.skipped

    def start(self) -> None:
        """Wake it up in Passive mode, stopped, and start the stream; completes any command a predecessor cut off."""
        self._line.write(oi.RESYNC + oi.HALT + oi.START + oi.stream(STREAMED))

    def arm(self) -> None:
        """Enter Safe mode: from now on it drives, and stops by itself at a cliff or when it is lifted."""
        self._line.write(oi.SAFE)

    def sensors(self) -> list[Sensors]:
        """Return all frames that have arrived, the newest last; after a pause they are more than one reading holds."""
        chunks = iter(lambda: self._line.read(0), b"")
        return [read_sensors(values) for chunk in chunks for values in self._parser.feed(chunk)]

    def drive(self, left: int, right: int) -> None:
        """Turn the wheels, in mm/s."""
        self._line.write(oi.drive_direct(right=right, left=left))

    def halt(self) -> None:
        """Stand still."""
        self._line.write(oi.HALT)

    def release(self) -> None:
        """Stand still, be silent and go to Passive mode, in which the battery is charged and does not drain."""
        self._line.write(oi.HALT + oi.pause_stream() + oi.START)
