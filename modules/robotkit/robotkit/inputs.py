"""The newest samples of all inputs. The bus never waits: samples a slow task can't take are dropped and counted."""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from robotkit.stamps import attached

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import zenoh

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
    """A queue per input that drops its oldest sample when full. Inputs start paused."""

    def __init__(self, session: zenoh.Session, declared: Mapping[str, Input]) -> None:
        self.dropped = dict.fromkeys(declared, 0)
        self.shared = dict.fromkeys(declared, 0)
        """How many samples came through shared memory."""
        self._session = session
        self._declared = declared
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
        """Subscribe; does nothing if already subscribed."""
        if not self._subscribers and not self._closed:
            self._subscribers = [
                self._session.declare_subscriber(declaration.key, self._receiver(name))
                for name, declaration in self._declared.items()
            ]

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
        queue = self._queues[name]

        def receive(sample: zenoh.Sample) -> None:
            received = time.time_ns()
            arrived = _Arrived(sample.payload, attached(sample), received, str(sample.key_expr))
            self.shared[name] += sample.payload.as_shm() is not None
            with self._changed:
                self.dropped[name] += len(queue) == queue.maxlen
                queue.append(arrived)
                self._changed.notify_all()

        return receive


def _intact(arrived: _Arrived, copied: bytes) -> bool:
    """Whether what was just copied is what was sent.

    Zenoh takes shared memory back from a process that stood still for a while, as a throttled one does, so that it
    blocks nobody; the sender's next frames are written there, even while we copy. `is_valid` calls some of them valid,
    and for others it gives an empty payload, or where the frame was instead of the frame; so that only the sender's
    checksum is proof. ROS messages and those of other publishers have none.
    """
    shared = arrived.payload.as_shm()
    return (shared is None or shared.is_valid()) and arrived.attached.fits(copied)
