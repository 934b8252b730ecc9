"""The streams of a policy as one observable of inputs, from Zenoh."""

from __future__ import annotations

import time
from collections import Counter
from threading import Lock
from typing import TYPE_CHECKING, Protocol, TypeAlias

import zenoh
from reactivex import Observable
from reactivex.disposable import CompositeDisposable, Disposable

from contextpolicy.errors import DecodeError
from contextpolicy.planning.conditions.sample import Sample
from contextpolicy.planning.inputs import Gone
from contextpolicy.policy.stream_spec import Encoding
from contextpolicy.streams.decoding import MAX_PAYLOAD, Decoder
from contextpolicy.streams.direct import directly
from contextpolicy.streams.latched import subscribe_latched
from contextpolicy.streams.senders import follow_senders
from contextpolicy.streams.wall_clock import STEP, ahead

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from reactivex.abc import DisposableBase, ObserverBase, SchedulerBase

    from contextpolicy.planning.inputs import Input
    from contextpolicy.policy.stream_spec import Stream
    from contextpolicy.streams.backlog import Backlog, Lane

_Arrived: TypeAlias = tuple[Decoder, bytes, bytes, str, float]
"""A payload with its attachment, its key where the stream's has wildcards, and the monotonic time of its arrival."""
Waiting: TypeAlias = _Arrived | Gone
"""What waits for the loop."""

LONGEST_KEY = 1024
"""Characters of a sample's key; those of ROS 2 have some 200, but any sender may choose one of 64 kB."""
BATCH = 100
"""Samples taken in a row; then timers and finished patches get their turn, however fast samples come."""


class SampleListener(Protocol):
    """Receives samples before they are decoded, and those that are dropped; called on the loop."""

    def on_arrival(self, arrived: float, stream: str, payload: bytes, attachment: bytes, key: str) -> None:
        """A sample is about to be decoded: its key is empty where the stream's has no wildcard."""

    def admits(self, stream: Stream, size: int) -> bool:
        """Whether there is room to keep a sample that took so many bytes, as its stream may do."""

    def on_drop(self, stream: str, reason: str) -> None:
        """A sample can't be decoded, is too large, or found no room in the backlog or to be kept."""


def inputs(
    session: zenoh.Session,
    streams: Sequence[Stream],
    scheduler: SchedulerBase,
    listener: SampleListener,
    backlog: Backlog[Waiting],
) -> Observable[Input]:
    """Samples and lost liveliness of all streams, on the scheduler's thread.

    A sample that is dropped never ends the stream. A sample's `arrived` is the monotonic time at which Zenoh delivered
    it, before it waited for the loop.
    """

    def subscribe(observer: ObserverBase[Input], _: SchedulerBase | None = None) -> DisposableBase:
        inbox = _Inbox(observer, scheduler, backlog, listener)
        declared = [_declare(session, stream, inbox, scheduler) for stream in streams]
        undone = [Disposable(undeclare) for own in declared for undeclare in own]
        return CompositeDisposable(*undone, Disposable(inbox.close))

    return Observable(subscribe)


def _declare(
    session: zenoh.Session, stream: Stream, inbox: _Inbox, scheduler: SchedulerBase
) -> list[Callable[[], None]]:
    decoder, wild, lane = Decoder(stream), "*" in stream.key, inbox.lane(stream.name)

    def on_sample(sample: zenoh.Sample) -> None:
        attached = sample.attachment if decoder.reads_attachment else None
        size = len(sample.payload) + (0 if attached is None else len(attached))
        key = str(sample.key_expr) if wild else ""
        # Before anything is copied: samples that are never read must not take memory either.
        if size > MAX_PAYLOAD or len(key) > LONGEST_KEY:
            inbox.refuse(stream.name)
        elif size or sample.kind == zenoh.SampleKind.PUT:  # a deletion has no payload
            attachment = b"" if attached is None else attached.to_bytes()
            inbox.put(lane, decoder, sample.payload.to_bytes(), attachment, key)

    # ROS 2 has latched topics.
    if stream.encoding is Encoding.CDR:
        declared = [subscribe_latched(session, stream.key, on_sample, scheduler)]
    else:
        declared = [session.declare_subscriber(stream.key, directly(on_sample)).undeclare]
    if stream.liveliness is not None:
        declared.append(follow_senders(session, stream.liveliness, _Ended(inbox, lane, stream.name)))
    return declared


class _Ended:
    """Notifies a stream's lane that its last sender ended."""

    def __init__(self, inbox: _Inbox, lane: Lane[Waiting], stream: str) -> None:
        self._inbox, self._lane, self._stream = inbox, lane, stream

    def on_gone(self) -> None:
        """Behind the samples that came before."""
        self._inbox.put_gone(self._lane, self._stream)


class _Inbox:
    """Hands samples from Zenoh's threads, which must not block, to the loop: one wake-up for all that has arrived."""

    def __init__(
        self,
        observer: ObserverBase[Input],
        scheduler: SchedulerBase,
        backlog: Backlog[Waiting],
        listener: SampleListener,
    ) -> None:
        self._observer, self._scheduler, self._listener = observer, scheduler, listener
        self._backlog = backlog
        self._streams: list[str] = []
        self._lanes: list[Lane[Waiting]] = []
        self._lock = Lock()
        self._awake = False
        """Whether the loop is to drain, or does; changed to true under the lock only, so that one drain is queued."""
        self._oversized: Counter[str] = Counter()
        self._closed = False
        """Read and set under the lock by other threads; a drain that is queued by then reports nothing any more."""
        self._ahead = 0.0
        """The loop's time minus the wall clock, in seconds: 0 from the loop's start until the wall clock is set."""

    def lane(self, stream: str) -> Lane[Waiting]:
        """Where samples of a stream wait."""
        lane = self._backlog.lane()
        self._streams.append(stream)
        self._lanes.append(lane)
        return lane

    def close(self) -> None:
        """Deliver nothing more, report nothing, and take nothing."""
        with self._lock:
            self._closed = True
            self._oversized.clear()
        for lane in self._lanes:
            self._backlog.close(lane)

    def put(
        self, lane: Lane[Waiting], decoder: Decoder, payload: bytes, attachment: bytes = b"", key: str = ""
    ) -> None:
        """Take a sample; called on a Zenoh thread.

        Wakes the loop only if it is not awake already: it empties the whole inbox.
        """
        size = len(payload) + len(attachment) + len(key)
        self._backlog.put(lane, (decoder, payload, attachment, key, time.monotonic()), size)
        if not self._awake:
            self._wake()

    def put_gone(self, lane: Lane[Waiting], stream: str) -> None:
        """Take the end of a liveliness token; called on a Zenoh thread."""
        self._backlog.put(lane, Gone(stream), 0)
        if not self._awake:
            self._wake()

    def refuse(self, stream: str) -> None:
        """Count a sample that is too large to be read; called on a Zenoh thread."""
        with self._lock:
            if self._closed:
                return
            self._oversized[stream] += 1
        if not self._awake:
            self._wake()

    def _wake(self) -> None:
        with self._lock:
            asleep, self._awake = not self._awake, True
        if asleep:
            self._scheduler.schedule(self._drain)

    def _drain(self, *_: object) -> None:
        """Deliver what has arrived, oldest first, up to a batch; then queue behind the loop's other work, or sleep."""
        waiting = 0
        for lane in self._lanes:
            waiting += len(lane.waiting)
        try:
            for _turn in range(min(BATCH, waiting)):
                item = self._backlog.take(self._lanes)
                if item is not None:
                    self._deliver(item)
            if self._oversized or self._backlog.overran:
                self._tell_lost()
        # Even after an exception: the inbox would stay marked awake and never be drained again.
        finally:
            # In this order: a sample that comes meanwhile either is seen here or finds us asleep and wakes us.
            self._awake = False
            more = bool(self._oversized)
            for lane in self._lanes:
                more = more or bool(lane.waiting)
            if more:
                self._wake()

    def _tell_lost(self) -> None:
        for stream, lane in zip(self._streams, self._lanes, strict=True):
            for _ in range(self._backlog.overrun(lane)):
                self._report_drop(stream, "overrun")
        if self._oversized:
            with self._lock:
                oversized, self._oversized = self._oversized, Counter()
            for stream in oversized.elements():
                self._report_drop(stream, "oversized")

    def _report_drop(self, stream: str, reason: str) -> None:
        if not self._closed:
            self._listener.on_drop(stream, reason)

    def _deliver(self, item: Waiting) -> None:
        if isinstance(item, Gone):
            self._observer.on_next(item)
            return
        decoder, payload, attachment, key, arrived = item
        self._listener.on_arrival(arrived, decoder.stream.name, payload, attachment, key)
        try:
            sample = decoder.decode(payload, attachment)
        except DecodeError:
            self._report_drop(decoder.stream.name, "undecodable")
            return
        if not self._listener.admits(decoder.stream, len(payload) + len(key)):
            self._report_drop(decoder.stream.name, "memory")
            return
        taken = None if sample.timestamp is None else self._on_our_clock(sample.timestamp)
        self._observer.on_next(Sample(sample.stream, sample.value, taken, arrived, key))

    def _on_our_clock(self, timestamp: float) -> float:
        """A time of the wall clock, which senders use, and which can step, as the loop's.

        All are shifted alike between two steps, to the last digit: samples are judged by the order of their timestamps,
        and a simulation may give many the same.
        """
        if abs(ahead(self._scheduler) - self._ahead) > STEP:
            # To be interrupted between the two readings makes it smaller.
            self._ahead = max(ahead(self._scheduler) for _ in range(3))
        return timestamp + self._ahead
