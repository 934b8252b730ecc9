"""The timing of each sample that is done, for experiments: on `robot/<task>/runs`, as lists.

One message for each sample would cost the task, and a bus that is short of CPU would lose some of them.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

import zenoh

from robotkit import json_text

if TYPE_CHECKING:
    from collections.abc import Mapping


class RunLog:
    """Collects on one thread, publishes on another."""

    def __init__(self, session: zenoh.Session, task: str) -> None:
        self._kept: deque[Mapping[str, Any]] = deque()
        self._publisher = session.declare_publisher(
            f"robot/{task}/runs",
            encoding=zenoh.Encoding.APPLICATION_JSON,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )

    def add(self, timing: Mapping[str, Any]) -> None:
        """Note that a sample is done."""
        self._kept.append(timing)

    def publish(self) -> None:
        """Publish what was added since the last time; waits where the bus is busy."""
        timings = [self._kept.popleft() for _ in range(len(self._kept))]
        if timings:
            self._publisher.put(json_text.dumps(timings))
