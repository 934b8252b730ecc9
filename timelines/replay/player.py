"""Publishes a timeline's inputs when they are due.

Every deadline counts from the start of the pass, so that a late input delays no other. The options are named as in
`ros2 bag play`. Inputs that the bus can't take at once are dropped, as a sensor would drop them, and who asks
for the newest one gets it.
"""

from __future__ import annotations

import heapq
import json
import time
from collections import Counter, defaultdict
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from itertools import chain, islice, takewhile
from operator import itemgetter
from typing import TYPE_CHECKING, Protocol, TypeAlias

import zenoh

from contextpolicy.policy.key_expressions import selects
from contextpolicy.streams.attachment import attach
from contextpolicy.streams.recorded_message import Topic
from contextpolicy.streams.ros_message import RosMessage
from robotkit.newest import Newest
from robotkit.outputs import CDR
from robotkit.stamps import attachment
from timelines.datasets.readers import read
from timelines.datasets.recordings import ROOT
from timelines.recording.ros_topics import topic_name

if TYPE_CHECKING:
    import threading
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from contextpolicy.streams.timeline import Timeline, TimelineEntry

    Payload: TypeAlias = bytes | RosMessage | object
    Timed: TypeAlias = tuple[float, str, Payload]


_ENCODINGS = {
    "json": zenoh.Encoding.APPLICATION_JSON,
    "binary": zenoh.Encoding.ZENOH_BYTES,
    CDR: zenoh.Encoding.ZENOH_BYTES,  # as rmw_zenoh leaves it
}
_ROS = "::msg::dds_::"
"""In every key of rmw_zenoh."""
_GID = b"timeline player."
"""The publisher's 16-byte id in rmw_zenoh's attachment."""


@dataclass(frozen=True, slots=True)
class Options:
    """Playback options; times are in seconds of the timeline, before `rate` is applied."""

    rate: float = 1.0
    start_offset: float = 0.0
    playback_duration: float | None = None
    loop: bool = False


@dataclass
class Report:
    """What was published, and how late; `started` is in seconds since 1970."""

    timeline: str
    started: float
    finished: float = 0.0
    published: Counter[str] = field(default_factory=Counter)
    lateness: list[float] = field(default_factory=list)
    stamps: dict[str, list[int]] = field(default_factory=lambda: defaultdict(list))
    """Of each key: what each input has in its attachment, in ns since 1970, also where the bus lost it."""

    def as_json(self) -> dict[str, object]:
        """Summarise for people and programs."""
        late = sorted(self.lateness) or [0.0]
        at = {"p50": len(late) // 2, "p99": len(late) * 99 // 100, "max": len(late) - 1}
        return {
            "timeline": self.timeline,
            "started": self.started,
            "finished": self.finished,
            "published": dict(self.published),
            "lateness_ms": {name: round(late[index] * 1000, 3) for name, index in at.items()},
        }


class Inputs(Protocol):
    """What can be played: a timeline with its data sets, or a recording (`timelines.replay.recorded`)."""

    name: str
    duration: float

    @property
    def encodings(self) -> Mapping[str, str]:
        """Of each key: json, binary or cdr."""

    @property
    def topics(self) -> Mapping[str, Topic]:
        """Of the keys of ROS: the topic."""

    def timed(self, start: float) -> Iterator[Timed]:
        """Seconds, key and payload in the order of time, from `start` seconds on."""


class TimelineInputs:
    """A timeline with its data sets; DatasetError if one of them is missing."""

    def __init__(self, timeline: Timeline, datasets: Path = ROOT, topics: Sequence[str] = ()) -> None:
        self.name, self.duration, self._datasets = timeline.name, timeline.duration, datasets
        self._entries = [entry for entry in timeline.entries if wanted(entry.key, topics)]
        self.encodings = {entry.key: entry.encoding for entry in self._entries}
        self.topics = {entry.key: _topic(entry.key, entry.message) for entry in self._entries if entry.message}

    def timed(self, start: float) -> Iterator[Timed]:
        """All inputs from `start` on; those of one instant in the order of the file."""
        sources = [_samples(entry, self._datasets) for entry in self._entries]
        return (timed for timed in heapq.merge(*sources, key=itemgetter(0)) if timed[0] >= start)


def _topic(key: str, message: RosMessage) -> Topic:
    kind, definition, type_hash = message.definition()
    return Topic(topic_name(key), "cdr", kind, 0, type_hash, definition)


def wanted(key: str, topics: Sequence[str]) -> bool:
    """Whether a key is among those asked for; none stands for all."""
    return not topics or any(selects(topic, key) for topic in topics)


def play(
    timeline: Timeline,
    session: zenoh.Session,
    *,
    stop: threading.Event,
    options: Options = Options(),
    datasets: Path = ROOT,
) -> Report:
    """Publish a timeline until it ends or `stop` is set; raises DatasetError before the first input."""
    return publish(TimelineInputs(timeline, datasets), session, stop=stop, options=options)


def publish(inputs: Inputs, session: zenoh.Session, *, stop: threading.Event, options: Options = Options()) -> Report:
    """Publish until the inputs end or `stop` is set."""
    with ExitStack() as until:
        streams = {
            key: until.enter_context(closing(_Stream(session, key, encoding)))
            for key, encoding in inputs.encodings.items()
        }
        return _publish(inputs, streams, stop, options)


def _publish(inputs: Inputs, streams: Mapping[str, _Stream], stop: threading.Event, options: Options) -> Report:
    timed = _opened(inputs, options)
    report = Report(inputs.name, started=time.time())
    start, length = time.monotonic(), _length(inputs, options)
    while True:
        for at, key, payload in timed:
            due = start + (at - options.start_offset) / options.rate
            if stop.wait(max(due - time.monotonic(), 0)):
                break
            report.lateness.append(time.monotonic() - due)
            report.published[key] += 1
            report.stamps[key].append(streams[key].put(payload, report.published[key]))
        start += length / options.rate
        if stop.wait(max(start - time.monotonic(), 0)) or not options.loop:
            break
        timed = _opened(inputs, options)
    report.finished = time.time()
    return report


def _opened(inputs: Inputs, options: Options) -> Iterator[Timed]:
    """What to publish, its first input already read: opening recordings takes tenths of a second."""
    timed = _window(inputs, options)
    return chain(list(islice(timed, 1)), timed)


def _length(inputs: Inputs, options: Options) -> float:
    rest = inputs.duration - options.start_offset
    return rest if options.playback_duration is None else min(rest, options.playback_duration)


def _window(inputs: Inputs, options: Options) -> Iterator[Timed]:
    end = options.start_offset + _length(inputs, options)
    return takewhile(lambda timed: timed[0] < end, inputs.timed(options.start_offset))


def _samples(entry: TimelineEntry, datasets: Path) -> Iterator[Timed]:
    if entry.dataset is None:
        return ((timed.at, entry.key, timed.message or timed.value) for timed in entry.inputs())
    recorded = ((entry.start + at - entry.offset, entry.key, payload) for at, payload in read(datasets, entry.dataset))
    return takewhile(lambda timed: timed[0] < entry.end, (timed for timed in recorded if timed[0] >= entry.start))


class _Stream:
    """Publishes a key's inputs."""

    def __init__(self, session: zenoh.Session, key: str, encoding: str) -> None:
        self._publisher = session.declare_publisher(
            key,
            encoding=_ENCODINGS[encoding],
            congestion_control=zenoh.CongestionControl.DROP,
            express=True,
        )
        self._of_ros = _ROS in key
        self._newest = None if encoding == CDR else Newest(session, key, _ENCODINGS[encoding])

    def close(self) -> None:
        """Publish no more."""
        self._publisher.undeclare()
        if self._newest is not None:
            self._newest.close()

    def put(self, payload: Payload, sequence: int) -> int:
        """Send bytes as they are, JSON objects with the `stamp` of this moment, ROS 2 messages as rmw_zenoh sends them.

        Returns the stamp.
        """
        stamp = time.time_ns()
        if isinstance(payload, RosMessage):
            sent, attached = payload.payload(stamp), attach(sequence, stamp, _GID)
        elif isinstance(payload, bytes):
            sent, attached = payload, attach(sequence, stamp, _GID) if self._of_ros else attachment(stamp)
        else:
            value = {"stamp": stamp, **payload} if isinstance(payload, dict) else payload
            sent, attached = json.dumps(value).encode(), attachment(stamp)
        self._publisher.put(sent, attachment=attached)
        if self._newest is not None:
            self._newest.keep(sent, attached)
        return stamp
