"""The streams of a policy as one observable of inputs, from Zenoh."""

from __future__ import annotations

import time
from collections import Counter, deque
from contextlib import suppress
from threading import Lock
from typing import TYPE_CHECKING, TypeAlias

import zenoh
import zenoh.ext
from reactivex import Observable
from reactivex.disposable import CompositeDisposable, Disposable

from contextpolicy.errors import DecodeError
from contextpolicy.planning.conditions.sample import Sample
from contextpolicy.planning.inputs import Gone
from contextpolicy.policy.spec import Encoding
from contextpolicy.streams.decoding import Decoder

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from reactivex.abc import DisposableBase, ObserverBase, SchedulerBase

    from contextpolicy.planning.inputs import Input
    from contextpolicy.policy.spec import Stream

_Arrived: TypeAlias = tuple[Decoder, bytes, bytes, str, float]
"""A payload with its attachment, its key where the stream's has wildcards, and the monotonic time of its arrival."""
Tap: TypeAlias = "Callable[[float, str, bytes, bytes, str], object]"
"""Called on the loop with each sample's arrival, stream, payload, attachment and key, before it is decoded."""

BACKLOG = 10_000
"""Samples that may wait for the loop; beyond that the oldest is dropped: a newer reading is worth more."""

STEP = 0.005
"""Seconds by which the wall clock must differ from what was known of it to count as set; less is noise."""

BATCH = 100
"""Samples taken in a row; then timers and finished patches get their turn, however fast samples come."""


def inputs(
    session: zenoh.Session,
    streams: Sequence[Stream],
    scheduler: SchedulerBase,
    on_drop: Callable[[str, str], None],
    tap: Tap = lambda *_: None,
) -> Observable[Input]:
    """Samples and lost liveliness of all streams, on the scheduler's thread.

    A payload that can't be decoded goes to `on_drop(stream, reason)` and never ends the stream. A sample's `arrived` is
    the monotonic time at which Zenoh delivered it, before it waited for the loop.
    """

    def subscribe(observer: ObserverBase[Input], _: SchedulerBase | None = None) -> DisposableBase:
        inbox = _Inbox(observer, scheduler, on_drop, tap)
        declared = [_declare(session, stream, inbox) for stream in streams]
        return CompositeDisposable(*(Disposable(undeclare) for own in declared for undeclare in own))

    return Observable(subscribe)


def _declare(session: zenoh.Session, stream: Stream, inbox: _Inbox) -> list[Callable[[], None]]:
    decoder, wild = Decoder(stream), "*" in stream.key

    def on_sample(sample: zenoh.Sample) -> None:
        payload = sample.payload.to_bytes()
        if payload or sample.kind == zenoh.SampleKind.PUT:  # a deletion has no payload
            attached = sample.attachment if decoder.reads_attachment else None
            key = str(sample.key_expr) if wild else ""
            inbox.put(decoder, payload, b"" if attached is None else attached.to_bytes(), key)

    def on_token(sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            inbox.put_gone(stream.name)

    declared: list[Callable[[], None]] = [_subscribe(session, stream, on_sample)]
    if stream.liveliness is not None:
        token = session.liveliness().declare_subscriber(stream.liveliness, on_token, history=True)
        declared.append(token.undeclare)
    return declared


def _subscribe(session: zenoh.Session, stream: Stream, on_sample: Callable[[zenoh.Sample], None]) -> Callable[[], None]:
    """Subscribe; call the result to undo it.

    Publishers of latched ROS 2 topics (transient_local) may publish once and keep that sample for late subscribers:
    rmw_zenoh serves it to Zenoh's advanced subscribers. Live samples do not wait for it.
    """
    if stream.encoding is not Encoding.CDR:
        return session.declare_subscriber(stream.key, on_sample).undeclare
    last = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
    return zenoh.ext.declare_advanced_subscriber(session, stream.key, on_sample, history=last).undeclare


class _Inbox:
    """Hands samples from Zenoh's threads, which must not block, to the loop: one wake-up for all that has arrived."""

    def __init__(
        self,
        observer: ObserverBase[Input],
        scheduler: SchedulerBase,
        on_drop: Callable[[str, str], None],
        tap: Tap = lambda *_: None,
    ) -> None:
        self._observer, self._scheduler, self._on_drop, self._tap = observer, scheduler, on_drop, tap
        self._waiting: deque[_Arrived | Gone] = deque()
        self._lock = Lock()
        self._awake = False
        """Whether the loop is to drain, or does; changed to true under the lock only, so that one drain is queued."""
        self._overrun: Counter[str] = Counter()
        self._ahead = 0.0
        """The loop's time minus the wall clock, in seconds: 0 from the loop's start until the wall clock is set."""

    def put(self, decoder: Decoder, payload: bytes, attachment: bytes = b"", key: str = "") -> None:
        """Take a sample; called on a Zenoh thread."""
        self._append((decoder, payload, attachment, key, time.monotonic()))

    def put_gone(self, stream: str) -> None:
        """Take the end of a liveliness token; called on a Zenoh thread."""
        self._append(Gone(stream))

    def _append(self, item: _Arrived | Gone) -> None:
        """Wake the loop only if it is not awake already: it empties the whole inbox."""
        if len(self._waiting) >= BACKLOG:
            self._discard_oldest()
        self._waiting.append(item)
        if not self._awake:
            self._wake()

    def _wake(self) -> None:
        with self._lock:
            asleep, self._awake = not self._awake, True
        if asleep:
            self._scheduler.schedule(self._drain)

    def _discard_oldest(self) -> None:
        # The loop may have emptied the inbox meanwhile.
        with self._lock, suppress(IndexError):
            self._overrun[_stream(self._waiting.popleft())] += 1

    def _drain(self, *_: object) -> None:
        """Deliver what has arrived, oldest first, up to a batch; then queue behind the loop's other work, or sleep."""
        if self._overrun:
            self._tell_overrun()
        try:
            for _turn in range(min(BATCH, len(self._waiting))):
                self._deliver(self._waiting.popleft())
        # Even after an exception: the inbox would stay marked awake and never be drained again.
        finally:
            # In this order: a sample that comes meanwhile either is seen here or finds us asleep and wakes us.
            self._awake = False
            if self._waiting:
                self._wake()

    def _tell_overrun(self) -> None:
        with self._lock:
            overrun, self._overrun = self._overrun, Counter()
        for stream in overrun.elements():
            self._on_drop(stream, "overrun")

    def _deliver(self, item: _Arrived | Gone) -> None:
        if isinstance(item, Gone):
            self._observer.on_next(item)
            return
        decoder, payload, attachment, key, arrived = item
        self._tap(arrived, decoder.stream.name, payload, attachment, key)
        try:
            sample = decoder.decode(payload, attachment)
        except DecodeError:
            self._on_drop(decoder.stream.name, "undecodable")
            return
        taken = None if sample.timestamp is None else self._on_our_clock(sample.timestamp)
        self._observer.on_next(Sample(sample.stream, sample.value, taken, arrived))

    def _on_our_clock(self, timestamp: float) -> float:
        """A time of the wall clock, which senders use, and which can step, as the loop's.

        All are shifted alike between two steps, to the last digit: samples are judged by the order of their timestamps,
        and a simulation may give many the same.
        """
        if abs(self._difference() - self._ahead) > STEP:
            # To be interrupted between the two readings makes it smaller.
            self._ahead = max(self._difference() for _ in range(3))
        return timestamp + self._ahead

    def _difference(self) -> float:
        return self._scheduler.to_seconds(self._scheduler.now) - time.time()


def _stream(item: _Arrived | Gone) -> str:
    return item.stream if isinstance(item, Gone) else item[0].stream.name
