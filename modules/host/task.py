"""The computer as a sensor."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from robotkit import Result, Task

if TYPE_CHECKING:
    import threading
    from collections.abc import Iterator

    from modules.host.sensors import Host

EVERY_S = 1.0


class HostSensors(Task):
    """Publishes a reading once a second: heat and pressure change slower than that."""

    def __init__(self, host: Host) -> None:
        self._host = host

    def produce(self, ended: threading.Event) -> Iterator[Result]:
        """Give readings until the end."""
        while True:
            yield Result("state", asdict(self._host.read()))
            if ended.wait(EVERY_S):
                return
