"""Talks to the RPLIDAR A1 over a serial line."""

from __future__ import annotations

import time
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple

from modules.lidar import rplidar
from modules.lidar.scan import HALF_BIN, CapsuleParser, NodeParser, Turns
from robotkit import DeviceError

if TYPE_CHECKING:
    import threading
    from collections.abc import Iterator

    from modules.lidar.rplidar import Descriptor, Health, Info, Node
    from modules.lidar.scan import ScanParser
    from robotkit.line import Line

ANSWER_S = 1.0
SPIN_UP_S = 2.0
"""Seconds that the motor may take until the first samples come."""
SETTLE_S = 0.02
"""Seconds of silence to wait for after STOP or RESET; the lidar ignores requests for the first 1 or 2 ms."""
CYCLE_S = 0.05
LATE_S = 0.3
"""The longest pause between two readings after which what waited is still used. A serial port's buffer, 4 KiB, is full
after 0.4 s, and then keeps what came first."""
MODES = {"standard": 500, "express": 250}
"""How long a sample takes, in us (data sheet)."""


class Seen(NamedTuple):
    """A turn, how long it took in ns, and when it ended, in ns since 1970."""

    nodes: list[Node]
    took: int
    ended: int


class Scanner:
    """Checks the device's health, starts it, and yields turns; DeviceError when it falls silent.

    A turn begins just past the angle `forward`, so that its samples are in the order of `scan.ranges`, backward: the
    lidar turns clockwise.
    """

    def __init__(self, line: Line, mode: str, *, forward: float = 0.0) -> None:
        express = mode == "express"
        self._line = line
        self._sample_ns = MODES[mode] * 1000
        self._turns = Turns(forward + HALF_BIN)
        self._parser: ScanParser = CapsuleParser() if express else NodeParser()
        self._request = rplidar.EXPRESS_SCAN if express else rplidar.SCAN
        self._descriptor = rplidar.EXPRESS_DESCRIPTOR if express else rplidar.SCAN_DESCRIPTOR

    @property
    def skipped(self) -> int:
        """Bytes that belonged to no sample."""
        return self._parser.skipped

    @property
    def lost(self) -> int:
        """Turns in which something was missing."""
        return self._turns.lost

    def start(self) -> Info:
        """Start the motor and the scan, and identify the device; DeviceError if it reports a fault."""
        self._line.set_wire("dtr", on=False)  # the A1's motor runs while DTR is low
        self._quiet(rplidar.STOP)
        health = self._health()
        if health.status == rplidar.PROTECTING:
            self._quiet(rplidar.RESET)
            health = self._health()
        if health.status == rplidar.PROTECTING:
            raise DeviceError(f"{self._line.name}: the lidar has shut itself down, error code {health.error:#06x}")
        info = rplidar.decode_info(self._ask(rplidar.GET_INFO, rplidar.INFO_DESCRIPTOR))
        self._parser.feed(self._ask(self._request, self._descriptor, size=0))
        return info

    def turns(self, ended: threading.Event) -> Iterator[Seen]:
        """Return full turns until `ended` is set; after a pause, only what was measured since."""
        read = heard = time.monotonic()
        patience = SPIN_UP_S
        while not ended.wait(CYCLE_S):
            data, before, read = self._line.read(0), read, time.monotonic()
            if data:
                heard, patience = read, ANSWER_S
                if read - before <= LATE_S:
                    yield from self._complete(data, time.time_ns())
                else:
                    self._catch_up()
            elif read - heard > patience:
                raise DeviceError(f"{self._line.name}: no samples for {patience:g} s")

    def _catch_up(self) -> None:
        """Discard what waited in the line while this process was frozen or throttled: it is old by now."""
        while self._line.read(0):
            pass
        self._parser.forget()
        self._turns.forget()

    def _complete(self, data: bytes, read: int) -> list[Seen]:
        """Return the turns that these bytes complete; what was read last was measured at `read`, in ns since 1970."""
        turns = self._turns.add(self._parser.feed(data))
        last = read - self._parser.held * self._sample_ns
        return [Seen(nodes, len(nodes) * self._sample_ns, last - later * self._sample_ns) for nodes, later in turns]

    def release(self) -> None:
        """Switch off laser and motor."""
        with suppress(DeviceError):
            self._line.write(rplidar.STOP)
            self._line.set_wire("dtr", on=True)

    def _health(self) -> Health:
        return rplidar.decode_health(self._ask(rplidar.GET_HEALTH, rplidar.HEALTH_DESCRIPTOR))

    def _quiet(self, request: bytes) -> None:
        """Send a request that has no answer, and discard what the lidar is still sending."""
        self._line.write(request)
        deadline = time.monotonic() + ANSWER_S
        while self._line.read(SETTLE_S) and time.monotonic() < deadline:
            pass

    def _ask(self, request: bytes, descriptor: Descriptor, *, size: int | None = None) -> bytes:
        """Return the whole answer; with `size`, everything received of it once it has at least `size` bytes."""
        self._line.write(request)
        wanted = descriptor.size if size is None else size
        heard, deadline = b"", time.monotonic() + ANSWER_S
        while (left := deadline - time.monotonic()) > 0:
            heard += self._line.read(left)
            at = rplidar.find_answer(heard, descriptor)
            if at is not None and len(heard) >= at + wanted:
                return heard[at : at + wanted] if size is None else heard[at:]
        raise DeviceError(
            f"{self._line.name}: no answer to {request.hex(' ')} within {ANSWER_S:g} s, but {heard[:20]!r}"
        )
