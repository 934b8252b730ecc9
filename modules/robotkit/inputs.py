"""The newest samples of a key. The bus is never kept waiting: what a slow task cannot take is dropped and counted."""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import zenoh


@dataclass(frozen=True, slots=True)
class Received:
    """One sample; `stamp` is when its source published it, `received` when it arrived, both in ns since 1970."""

    payload: bytes
    stamp: int
    received: int


class Input:
    """A queue of at most `depth` samples that drops the oldest. It starts paused."""

    def __init__(self, session: zenoh.Session, key: str, *, depth: int = 1) -> None:
        self.dropped = 0
        self._session = session
        self._key = key
        self._queue: deque[Received] = deque(maxlen=depth)
        self._changed = threading.Condition()
        self._subscriber: zenoh.Subscriber[None] | None = None
        self._closed = False

    def resume(self) -> None:
        """Subscribe. Does nothing when the input runs already."""
        if self._subscriber is None and not self._closed:
            self._subscriber = self._session.declare_subscriber(self._key, self._hand_over)

    def pause(self) -> None:
        """Unsubscribe, so that not even the transport costs CPU, and forget what was queued."""
        if self._subscriber is not None:
            self._subscriber.undeclare()
            self._subscriber = None
        with self._changed:
            self._queue.clear()

    def take(self) -> Received | None:
        """Wait for the oldest sample in the queue; None means that the input was closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._queue or self._closed)
            return None if self._closed else self._queue.popleft()

    def close(self) -> None:
        """Wake up whoever waits. Allowed in a signal handler; the session undeclares the rest."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _hand_over(self, sample: zenoh.Sample) -> None:
        received = time.time_ns()
        arrived = Received(sample.payload.to_bytes(), _stamp(sample) or received, received)
        with self._changed:
            self.dropped += len(self._queue) == self._queue.maxlen
            self._queue.append(arrived)
            self._changed.notify_all()


def stamp_attachment(stamp: int) -> bytes:
    """Tell in a sample's attachment when its source published it."""
    return json.dumps({"stamp": stamp}).encode()


def _stamp(sample: zenoh.Sample) -> int | None:
    if sample.attachment is None:
        return None
    try:
        stamp = json.loads(sample.attachment.to_bytes())["stamp"]
    except (ValueError, KeyError, TypeError):  # someone else's attachment
        return None
    return stamp if isinstance(stamp, int) else None
