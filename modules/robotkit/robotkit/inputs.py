"""The newest samples of all inputs. The bus never waits: samples a slow task can't take are dropped and counted.

A task that resumes asks for the sample that was published just before: what made it resume was often seen there. Only
inputs of depth 1 do: a queue is for what must not be skipped, such as orders, and one of those alone may be revoked.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import zenoh

from robotkit.stamps import NOTHING, attached

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from robotkit.module import Input
    from robotkit.stamps import Attached


@dataclass(frozen=True, slots=True)
class Received:
    """One sample of an input. `key` is the key it was published on, since an input's key may have wildcards.

    `stamp` is when its source published it, `received` when it arrived, both in ns since 1970. `type` is its ROS type,
    as `ros` (a release) or the definitions in the folder `types` have it.
    """

    payload: bytes
    stamp: int
    received: int
    input: str = ""
    encoding: str = ""
    type: str = ""
    key: str = ""
    ros: str = "latest"
    types: str = ""


class _Arrived(NamedTuple):
    """A queued sample; its payload is copied only when the task takes it, so dropping one is cheap."""

    payload: zenoh.ZBytes
    attached: Attached
    received: int
    key: str


class Inputs:
    """A queue per input that drops its oldest sample when full. Inputs start paused.

    `deadline` is how old a sample may be, in seconds, to be worth asking for when they resume; None: none is.
    """

    def __init__(self, session: zenoh.Session, declared: Mapping[str, Input], deadline: float | None = None) -> None:
        self.dropped = dict.fromkeys(declared, 0)
        self.shared = dict.fromkeys(declared, 0)
        """How many samples came through shared memory."""
        self._session = session
        self._declared = declared
        self._deadline = deadline
        self._latest: dict[str, int] = {}
        """The stamp of the newest sample that arrived on each key, at most the time of its arrival."""
        self._given: dict[str, int] = {}
        """The stamp of the last answer that was taken on each key."""
        self._queues: dict[str, deque[_Arrived]] = {
            name: deque(maxlen=declaration.depth) for name, declaration in declared.items()
        }
        self._changed = threading.Condition()
        self._subscribers: list[zenoh.Subscriber[None]] = []
        self._closed = False
        self._taken: tuple[str, int] | None = None

    @property
    def unfinished(self) -> list[tuple[str, int]]:
        """Name and time of arrival of each sample in the queues, and of the one that the task took last."""
        with self._changed:
            waiting = [(name, arrived.received) for name, queue in self._queues.items() for arrived in queue]
            return waiting if self._taken is None else [self._taken, *waiting]

    def resume(self) -> None:
        """Subscribe, and ask for what was published just before; does nothing if already subscribed."""
        if self._subscribers or self._closed:
            return
        self._subscribers = [
            self._session.declare_subscriber(declaration.key, self._receiver(name))
            for name, declaration in self._declared.items()
        ]
        if self._deadline is not None:
            for name, declaration in self._declared.items():
                if declaration.depth == 1:
                    self._ask(name, declaration.key, self._deadline)

    def pause(self) -> None:
        """Unsubscribe, so that not even the transport costs CPU, and clear the queues."""
        for subscriber in self._subscribers:
            subscriber.undeclare()
        self._subscribers = []
        with self._changed:
            for queue in self._queues.values():
                queue.clear()

    def take(self) -> Received | None:
        """Block until there is a sample and return the one that arrived first; None once the inputs are closed."""
        while (taken := self._next()) is not None:
            name, arrived = taken
            payload = arrived.payload.to_bytes()
            if _intact(arrived, payload):
                own = self._declared[name]
                times = arrived.attached.stamp or arrived.received, arrived.received
                return Received(payload, *times, name, own.encoding, own.type, arrived.key, own.ros, own.types)
            with self._changed:
                self.dropped[name] += 1
        return None

    def _next(self) -> tuple[str, _Arrived] | None:
        """Wait for the sample that arrived first, with its input's name; None once the inputs are closed."""
        with self._changed:
            self._taken = None
            self._changed.wait_for(lambda: self._closed or any(self._queues.values()))
            if self._closed:
                return None
            name = min((name for name in self._queues if self._queues[name]), key=self._first_arrival)
            arrived = self._queues[name].popleft()
            self._taken = (name, arrived.received)
            return name, arrived

    def close(self) -> None:
        """Wake up a blocked `take`; closing the session undeclares the subscribers."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _first_arrival(self, name: str) -> int:
        return self._queues[name][0].received

    def _receiver(self, name: str) -> Callable[[zenoh.Sample], None]:
        def receive(sample: zenoh.Sample) -> None:
            own, now = attached(sample), time.time_ns()
            with self._changed:
                # The answer may overtake the sample itself: callbacks run on threads of their own.
                if own.stamp is None or own.stamp > self._given.get(str(sample.key_expr), -1):
                    self._enqueue(name, sample, own, now)

        return receive

    def _ask(self, name: str, key: str, deadline: float) -> None:
        """Ask for the newest sample; an answer that we do not fetch is dropped on the way, like any sample."""
        self._session.get(
            key,
            self._answered(name, deadline),
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=deadline,
            congestion_control=zenoh.CongestionControl.DROP,
            express=True,
        )

    def _answered(self, name: str, deadline: float) -> Callable[[zenoh.Reply], None]:
        """Takes an answer unless it has no stamp of the last `deadline` seconds, or it or a newer one has arrived."""
        subscribers = self._subscribers

        def receive(reply: zenoh.Reply) -> None:
            sample, now = reply.ok, time.time_ns()
            own = attached(sample) if sample else NOTHING
            with self._changed:
                paused = self._subscribers is not subscribers
                if sample is None or own.stamp is None or paused:
                    return
                key = str(sample.key_expr)
                if max(self._latest.get(key, 0), now - deadline * 1e9) < own.stamp <= now:
                    self._given[key] = own.stamp
                    self._enqueue(name, sample, own, now)

        return receive

    def _enqueue(self, name: str, sample: zenoh.Sample, own: Attached, received: int) -> None:
        key = str(sample.key_expr)
        arrived = _Arrived(sample.payload, own, received, key)
        queue = self._queues[name]
        self.shared[name] += sample.payload.as_shm() is not None
        with self._changed:
            self._latest[key] = max(self._latest.get(key, 0), min(own.stamp or received, received))
            self.dropped[name] += len(queue) == queue.maxlen
            queue.append(arrived)
            self._changed.notify_all()


def _intact(arrived: _Arrived, copied: bytes) -> bool:
    """Whether what was just copied is what was sent.

    Zenoh takes shared memory back from a process that stood still for a while, as a throttled one does, so that it
    blocks nobody; the sender's next frames are written there, even while we copy. `is_valid` calls some of them valid,
    and for others it gives an empty payload, or where the frame was instead of the frame; so that only the sender's
    checksum is proof. ROS messages and those of other publishers have none.
    """
    shared = arrived.payload.as_shm()
    return (shared is None or shared.is_valid()) and arrived.attached.fits(copied)
