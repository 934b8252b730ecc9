"""Publishes `robot/<task>/health` once a second and answers queries for `robot/<task>/profile`."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Protocol

import zenoh

from robotkit import json_text
from robotkit.health import EVERY_S, Health, Queue, Snapshot
from robotkit.outputs import JSON, publisher
from robotkit.stamps import attachment

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from robotkit.cgroup import Usage
    from robotkit.profile import Profile
    from robotkit.quality import Quality


LAST_S = 1.0
"""Seconds that the message being sent at the end may take: the session is closed next."""


class Taken(Protocol):
    """What a task takes."""

    @property
    def dropped(self) -> Mapping[str, int]:
        """How many samples of each input were lost."""

    @property
    def shared(self) -> Mapping[str, int]:
        """How many came by shared memory."""

    @property
    def unfinished(self) -> Sequence[tuple[str, int]]:
        """Name and time of arrival of each sample that is not done."""


class Reporter:
    """Runs from its construction until `close`."""

    def __init__(  # noqa: PLR0913, PLR0917 - all that a task can be asked about
        self,
        session: zenoh.Session,
        task: str,
        profile: Profile,
        inputs: Taken,
        quality: Quality,
        usage: Usage,
    ) -> None:
        self._task = task
        self._profile = profile
        self._inputs = inputs
        self._quality = quality
        self._usage = usage
        self._health = Health(self._snapshot())
        self._suspended = False
        self._publisher = publisher(session, f"robot/{task}/health", JSON)
        self._queryable = session.declare_queryable(f"robot/{task}/profile", self._answer)
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._publish_health, name="health", daemon=True)
        self._thread.start()

    def suspended(self, *, suspended: bool) -> None:
        """Note whether the task is suspended; a change starts a new health window."""
        if suspended != self._suspended:
            self._suspended = suspended
            self._health.forget(self._snapshot())

    def close(self) -> None:
        """Stop reporting."""
        self._closed.set()
        self._queryable.undeclare()
        self._thread.join(LAST_S)

    def _publish_health(self) -> None:
        while not self._closed.wait(EVERY_S):
            stamp = time.time_ns()
            message = self._health.message(self._snapshot(), self._queue(stamp), suspended=self._suspended)
            message |= {"quality": round(self._quality.value, 3), "adaptive": self._quality.adaptive}
            self._publisher.put(json_text.dumps({"stamp": stamp, **message}), attachment=attachment(stamp))

    def _snapshot(self) -> Snapshot:
        records = self._profile.records
        return Snapshot(
            time=time.monotonic_ns(),
            cpu=self._usage.cpu(),
            done=sum(record.done for record in records),
            missed=sum(record.missed for record in records),
            dropped=sum(self._inputs.dropped.values()),
            broken=sum(record.broken for record in records),
            failures=self._profile.failures,
            latency=sum(record.latency for record in records),
            throttling=self._usage.throttling(),
        )

    def _queue(self, now: int) -> Queue:
        waiting = self._inputs.unfinished
        return Queue(
            length=len(waiting),
            overdue=sum(self._profile.inputs[name].overdue(received, now) for name, received in waiting),
            age=max((now - received for _, received in waiting), default=0),
        )

    def _answer(self, query: zenoh.Query) -> None:
        document = self._profile.as_json(self._task, self._inputs.dropped, self._inputs.shared)
        document["adaptive"] = self._quality.adaptive
        with query:
            # By its own key: of several replies on a question's wildcard, the bus would keep one.
            query.reply(
                f"robot/{self._task}/profile", json_text.dumps(document), encoding=zenoh.Encoding.APPLICATION_JSON
            )
