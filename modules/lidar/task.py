"""Publishes what is around the robot, turn by turn."""

from __future__ import annotations

import logging
import math
from typing import TYPE_CHECKING

from modules.lidar.rplidar import BAUD
from modules.lidar.scan import BINS, ranges
from modules.lidar.scanner import MODES, Scanner
from robotkit import ConfigurationError, Result, Task
from robotkit.line import open_line

if TYPE_CHECKING:
    import threading
    from collections.abc import Iterator, Mapping

    from modules.lidar.scanner import Seen

PORT = "/dev/ttyUSB1"
NEAREST, FARTHEST = 0.15, 12.0
"""Metres that the device measures (RPLIDAR A1, data sheet)."""

_LOG = logging.getLogger(__name__)


class Lidar(Task):
    """A source: it takes no input, and its motor and laser are off while it is suspended."""

    def __init__(self, port: str = PORT, *, mode: str = "standard", forward: float = 0.0) -> None:
        self._port = port
        self._mode = mode
        self._forward = forward

    def produce(self, ended: threading.Event) -> Iterator[Result]:
        """Return a scan per turn until `ended` is set, or DeviceError."""
        with open_line(self._port, BAUD) as line:
            scanner = Scanner(line, self._mode, forward=self._forward)
            try:
                info = scanner.start()
                _LOG.info("%s: RPLIDAR model %#x, firmware %d.%02d", self._port, info.model, *info.firmware)
                for turn in scanner.turns(ended):
                    counts = {"skipped": scanner.skipped, "lost": scanner.lost}
                    yield Result("scan", self._scan(turn) | counts, stamp=turn.ended)
            finally:
                scanner.release()

    def _scan(self, turn: Seen) -> dict[str, object]:
        """As in ROS: ray i was measured i * time_increment after the stamp, which is that of the first ray.

        Rays are counter-clockwise and the lidar turns clockwise, so the first ray was the last to be measured.
        """
        found = ranges(turn.nodes, forward=self._forward)
        return {
            "start_angle": 0.0,
            "end_angle": math.tau * (BINS - 1) / BINS,
            "range_min": NEAREST,
            "range_max": FARTHEST,
            "scan_time": turn.took / 1e9,
            "time_increment": -turn.took / 1e9 / BINS,
            "ranges": [round(distance, 3) for distance in found],
            "nearest": round(min(filter(None, found), default=0.0), 3),
            "samples": len(turn.nodes),
        }


def build(environment: Mapping[str, str]) -> Lidar:
    """Read the environment; ConfigurationError names every invalid variable."""
    mode, angle = environment.get("LIDAR_MODE", "standard"), environment.get("LIDAR_FORWARD", "0")
    problems = [] if mode in MODES else [f"LIDAR_MODE: invalid value {mode!r}: expected {' or '.join(MODES)}"]
    try:
        forward = float(angle)
    except ValueError:
        forward = math.nan
    if not math.isfinite(forward):
        problems.append(f"LIDAR_FORWARD: invalid value {angle!r}: expected an angle in degrees")
    if problems:
        raise ConfigurationError("\n".join(problems))
    return Lidar(environment.get("SERIAL_PORT", PORT), mode=mode, forward=forward)
