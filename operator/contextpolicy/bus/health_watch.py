"""What modules tell of themselves once a second: how much of their input they miss."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, NamedTuple

import zenoh

if TYPE_CHECKING:
    from collections.abc import Callable

    from reactivex.abc import SchedulerBase


class TaskHealth(NamedTuple):
    """The part of its inputs that a task missed lately, and whether it is suspended and so missed nothing."""

    misses: float
    suspended: bool


class HealthWatch:
    """Subscribes to `key`, whose `*` is the task's name; `on_health(task, health)` is called on the loop's thread."""

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        scheduler: SchedulerBase,
        on_health: Callable[[str, TaskHealth], None],
    ) -> None:
        self._place, self._scheduler, self._on_health = key.split("/").index("*"), scheduler, on_health
        self._subscriber = session.declare_subscriber(key, self._on_sample)

    def close(self) -> None:
        """Hear no more."""
        self._subscriber.undeclare()

    def _on_sample(self, sample: zenoh.Sample) -> None:
        """Zenoh's callbacks must not block."""
        task = str(sample.key_expr).split("/")[self._place]
        health = read_health(sample.payload.to_bytes()) if sample.kind == zenoh.SampleKind.PUT else None
        if health is not None:
            self._scheduler.schedule(lambda *_: self._on_health(task, health))


def read_health(payload: bytes) -> TaskHealth | None:
    """A module's message; None if it can't be read."""
    try:
        said = json.loads(payload)
        misses = float(said["misses"])
        return TaskHealth(misses, said.get("suspended") is True) if 0 <= misses <= 1 else None
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError):
        return None
