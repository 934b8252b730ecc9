"""JSON results with the times that belong to them."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import zenoh

from modules.robotkit.inputs import stamp_attachment

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True, slots=True)
class Timing:
    """When things happened, in ns since 1970, and how many samples the input has dropped so far."""

    stamp: int
    received: int
    started: int
    finished: int
    dropped: int


class Output:
    """Publishes results under one key; a result that the bus cannot take at once is dropped."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._publisher = session.declare_publisher(
            key,
            encoding=zenoh.Encoding.APPLICATION_JSON,
            congestion_control=zenoh.CongestionControl.DROP,
            express=True,
        )

    def publish(self, result: Mapping[str, object], timing: Timing) -> None:
        """Send the result with its timing added as `timing`."""
        payload = json.dumps({**result, "timing": asdict(timing)})
        self._publisher.put(payload, attachment=stamp_attachment(timing.finished))
