"""The health of the robot's tasks: whether they run, and whether any input waits."""

from __future__ import annotations

import json
import threading
import time
from typing import TYPE_CHECKING, Any

from timelines.demo import deploy

if TYPE_CHECKING:
    from collections.abc import Mapping

    import zenoh

HEALTH = "robot/*/health"
PATIENCE = 120.0
"""Seconds to wait for modules that start, and for queues that empty."""


class Healths:
    """The latest health message of each task, received in a session."""

    def __init__(self, session: zenoh.Session) -> None:
        self._changed = threading.Condition()
        self._latest: dict[str, dict[str, Any]] = {}
        session.declare_subscriber(HEALTH, self._hear)

    def _hear(self, sample: zenoh.Sample) -> None:
        """Take one message."""
        with self._changed:
            self._latest[str(sample.key_expr).split("/")[1]] = json.loads(sample.payload.to_bytes())
            self._changed.notify_all()

    def wait_until_ready(self, tasks: tuple[str, ...]) -> None:
        """Wait until all tasks of the robot are idle; DeployError if one does not report."""
        if not self.wait_for_all(tasks, time.time(), PATIENCE):
            raise deploy.DeployError(f"not all of {', '.join(tasks)} reported their health within {PATIENCE:g} s")

    def wait_for_all(self, tasks: tuple[str, ...], since: float, patience: float) -> bool:
        """Wait until each task has reported, after `since` (Unix seconds), that it is idle; False if one has not."""
        with self._changed:
            return self._changed.wait_for(lambda: all(idle(self._latest.get(task), since) for task in tasks), patience)


def idle(health: Mapping[str, Any] | None, since: float) -> bool:
    """Whether a task has reported after `since` that it is idle or suspended."""
    return health is not None and health["stamp"] > since * 1e9 and (health["suspended"] or not health["queue"])
