"""The messages of one key of the bus, each with the time at which it came."""

from __future__ import annotations

import json
import threading
import time
from typing import TYPE_CHECKING, Any

import zenoh

from tests.bench.reaction.stopwatch import MissedError

if TYPE_CHECKING:
    from collections.abc import Callable

    Message = dict[str, Any]


class Hearing:
    """Keeps all that was heard; times are Unix seconds."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._key = key
        self._messages: list[tuple[float, Message]] = []
        self._news = threading.Condition()
        self._subscriber: Any = session.declare_subscriber(key, self._hear)

    def since(self, moment: float) -> list[tuple[float, Message]]:
        """What was heard from that moment on."""
        with self._news:
            return [(at, message) for at, message in self._messages if at >= moment]

    def wait(self, wanted: Callable[[Message], bool], since: float, patience: float) -> tuple[float, Message]:
        """The first message from that moment on that is wanted; MissedError when there is none."""
        self.await_all(lambda messages: any(wanted(message) for message in messages), since, patience)
        return next((at, message) for at, message in self.since(since) if wanted(message))

    def await_all(self, complete: Callable[[list[Message]], bool], since: float, patience: float) -> None:
        """Wait until what was heard from that moment on is complete; MissedError when it does not get there."""
        with self._news:
            if not self._news.wait_for(
                lambda: complete([message for at, message in self._messages if at >= since]), patience
            ):
                raise MissedError(f"not heard on {self._key} within {patience:g} s")

    def close(self) -> None:
        """Hear no more."""
        self._subscriber.undeclare()

    def _hear(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            at = time.time()
            message = json.loads(sample.payload.to_bytes())
            with self._news:
                self._messages.append((at, message))
                self._news.notify_all()
