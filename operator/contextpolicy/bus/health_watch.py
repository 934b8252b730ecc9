"""What modules report once a second: how much of their input they miss."""

from __future__ import annotations

import json
from threading import Lock
from typing import TYPE_CHECKING, NamedTuple, Protocol

import zenoh

from contextpolicy.streams.direct import directly

if TYPE_CHECKING:
    from reactivex.abc import SchedulerBase


LARGEST = 4096
"""Bytes of a message: modules need a hundred."""
MOST_TASKS = 256
"""More than a policy can have."""


class TaskHealth(NamedTuple):
    """The part of its inputs that a task missed lately, and whether it is suspended and so missed nothing."""

    misses: float
    suspended: bool


class TaskHealthListener(Protocol):
    """Receives tasks' health; called on the loop's thread."""

    def on_task_health(self, policy: str, task: str, health: TaskHealth) -> None:
        """A task of the policy that is watched for has reported."""


class HealthWatch:
    """Subscribes to `key`, whose `*` is the task's name, for one policy (its reference).

    However fast messages come, the newest of each task waits for the loop, of at most `MOST_TASKS`.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        scheduler: SchedulerBase,
        policy: str,
        listener: TaskHealthListener,
    ) -> None:
        self._place, self._scheduler = key.split("/").index("*"), scheduler
        self._policy, self._listener = policy, listener
        self._waiting: dict[str, TaskHealth] = {}
        self._lock = Lock()
        self._subscriber = session.declare_subscriber(key, directly(self._on_sample))

    def close(self) -> None:
        """Unsubscribe."""
        self._subscriber.undeclare()

    def _on_sample(self, sample: zenoh.Sample) -> None:
        """Zenoh's callbacks must not block."""
        key = str(sample.key_expr)
        if sample.kind != zenoh.SampleKind.PUT or len(sample.payload) > LARGEST or "*" in key:
            return  # a key with wildcards may have fewer parts, and names no task
        health = read_health(sample.payload.to_bytes())
        if health is not None:
            self._put(key.split("/")[self._place], health)

    def _put(self, task: str, health: TaskHealth) -> None:
        with self._lock:
            idle = not self._waiting
            if task in self._waiting or len(self._waiting) < MOST_TASKS:
                self._waiting[task] = health
        if idle:
            self._scheduler.schedule(self._drain)

    def _drain(self, *_: object) -> None:
        with self._lock:
            heard, self._waiting = self._waiting, {}
        for task, health in heard.items():
            self._listener.on_task_health(self._policy, task, health)


def read_health(payload: bytes) -> TaskHealth | None:
    """A module's message; None if it can't be read."""
    try:
        said = json.loads(payload)
        misses = float(said["misses"])
        return TaskHealth(misses, said.get("suspended") is True) if 0 <= misses <= 1 else None
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError):
        return None
