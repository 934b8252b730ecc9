"""Recordings of robots: MCAP files of any origin, and rosbag2 folders (MCAP or SQLite), read message by message.

Payloads are given as they were recorded, byte for byte; streams decode them as they would on the robot. A damaged
recording is refused, or, with a `DamageLog`, read without what is damaged; `Recording` is in recorded_message.
"""

from __future__ import annotations

import bisect
import struct
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from contextpolicy.policy.key_expressions import selects
from contextpolicy.streams.recorded_message import NO_DAMAGE, Damage, Recorded, Recording, RecordingError, Topic
from contextpolicy.streams.timeline import RECORDED, Timeline, TimelineEntry

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from contextpolicy.policy.spec import Policy
    from contextpolicy.streams.recorded_message import Damages

CLOCK_TOPIC = "/clock"
"""Where simulators publish their time (rosgraph_msgs/msg/Clock)."""
HASH = "TypeHashNotSupported"
"""The last chunk of rmw_zenoh's keys for a type whose hash is not known."""
_CLOCK = {1: struct.Struct("<iI"), 0: struct.Struct(">iI")}
"""By the second byte of the CDR header: little and big endian."""


@dataclass(frozen=True, slots=True)
class Excerpt:
    """Which part of a recording counts, in the terms of `ros2 bag play`: seconds, and topics or key expressions."""

    start_offset: float = 0.0
    playback_duration: float | None = None
    topics: Sequence[str] = ()
    use_sim_time: bool = False

    def wants(self, topic: str) -> bool:
        """Whether a topic is among those asked for."""
        return not self.topics or any(selects(wanted, topic.strip("/")) for wanted in self.topics)


class DamageLog:
    """What was damaged in a recording that was read nevertheless, each part once."""

    def __init__(self) -> None:
        self.damages: list[Damage] = []

    def add(self, damage: Damage) -> None:
        """Go on reading behind a damaged part."""
        if (damage.path, damage.what) not in {(known.path, known.what) for known in self.damages}:
            self.damages.append(damage)

    @property
    def notes(self) -> list[str]:
        """A sentence for each."""
        return [f"{one.path} {one.what}; left out, {one.read or 'nothing was read'}" for one in self.damages]


def is_recording(path: Path) -> bool:
    """Whether a path is an MCAP file, a file or a folder of rosbag2, by its name."""
    return path.suffix in (".mcap", ".db3") or path.is_dir()


def open_recording(path: Path, excerpt: Excerpt, damages: Damages = NO_DAMAGE) -> Recording:
    """Open a recording, in simulated time if asked for; RecordingError says why it can't be read.

    What is damaged is noted in a `DamageLog` and left out; else it is an error, now or while messages are read.
    """
    from contextpolicy.streams.bag_recording import open_bag  # noqa: PLC0415 - slow to load

    def open_mcap(file: Path) -> Recording:
        try:
            from contextpolicy.streams.mcap_recording import McapRecording  # noqa: PLC0415 - an extra
        except ImportError as error:
            raise RecordingError(f"{file}: MCAP needs the package mcap: pip install '.[mcap]' in a checkout") from error
        return McapRecording(file, damages)

    recording = open_mcap(path) if path.suffix == ".mcap" else open_bag(path, open_mcap, damages)
    if not recording.topics:
        raise RecordingError(f"{path} has no message")
    return SimulatedTime(recording) if excerpt.use_sim_time else recording


class SimulatedTime:
    """A recording by the clock of its simulator: each message has the last time published on `/clock`."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        clock = list(recording.messages([CLOCK_TOPIC], recording.begin, recording.end))
        self._walls, self._times = [tick.at for tick in clock], [_clock_time(tick.payload) for tick in clock]
        if not clock:
            raise RecordingError(f"there is no simulated time: the recording has no messages on {CLOCK_TOPIC}")
        if self._times != sorted(self._times):
            raise RecordingError(f"simulated time runs backwards on {CLOCK_TOPIC}: record one run, without a reset")
        self.topics = recording.topics
        self.begin, self.end = self._times[0], self._times[-1]

    def messages(self, topics: Iterable[str], begin: int, end: int) -> Iterator[Recorded]:
        """Those before the first tick have no time, and are left out."""
        for message in self._recording.messages(topics, self._walls[0], self._recording.end):
            tick = bisect.bisect_right(self._walls, message.at) - 1
            if begin <= self._times[tick] <= end:
                yield message._replace(at=self._times[tick])


def _clock_time(payload: bytes) -> int:
    if len(payload) < 12:
        raise RecordingError(f"a message on {CLOCK_TOPIC} has {len(payload)} bytes, and no time")
    seconds, nanoseconds = _CLOCK[payload[1] & 1].unpack_from(payload, 4)
    return int(seconds) * 10**9 + int(nanoseconds)


def rmw_key(topic: Topic, last: str = HASH) -> str:
    """The key on which rmw_zenoh publishes a topic in domain 0."""
    package, _, kind = topic.type.partition("/msg/")
    return f"0/{topic.name.strip('/')}/{package}::msg::dds_::{kind}_/{last}"


def timeline_key(topic: Topic) -> str:
    """rmw_zenoh's key for a topic of ROS 2, with its type's hash if known; for anything else the topic itself."""
    if topic.encoding != "cdr" or "::msg::dds_::" in topic.name:
        return bridge_key(topic)
    return rmw_key(topic, topic.hash or HASH)


def bridge_key(topic: Topic) -> str:
    """The key on which zenoh-bridge-ros2dds publishes a topic, and on which we do."""
    return topic.name.strip("/")


def keys_for(policy: Policy) -> Callable[[Topic], str]:
    """Names each topic as the policy's streams would find it: by rmw_zenoh's key, or else by the topic alone."""

    def key(topic: Topic) -> str:
        for stream in policy.streams if "/msg/" in topic.type else ():
            last = stream.key.rpartition("/")[2]
            named = rmw_key(topic, last if last.startswith("RIHS") else HASH)
            if selects(stream.key, named):
                return named
        return bridge_key(topic)

    return key


def timeline_of(
    recording: Recording,
    excerpt: Excerpt,
    key: Callable[[Topic], str],
    *,
    name: str,
    wanted: Sequence[str],
) -> Timeline:
    """The messages that the key expressions `wanted` select, as a timeline; of other topics, that they exist."""
    begin, end = bounds(recording, excerpt)
    keys = {topic.name: key(topic) for topic in recording.topics.values() if excerpt.wants(topic.name)}
    read = [topic for topic, named in keys.items() if any(selects(expression, named) for expression in wanted)]
    blank = TimelineEntry(0.0, 0.0, "", RECORDED, None, None, None, None)
    blanks = {topic: replace(blank, key=named, type=_ros_type(recording, topic)) for topic, named in keys.items()}
    entries = [blanks[topic] for topic in keys if topic not in read]
    for message in recording.messages(read, begin, end):
        at = (message.at - begin) / 1e9
        entries.append(replace(blanks[message.topic], start=at, end=at, payload=message.payload))
    return Timeline(name, max((end - begin) / 1e9, 1e-9), tuple(entries), begin=begin / 1e9)


def _ros_type(recording: Recording, topic: str) -> str:
    known = recording.topics[topic]
    return known.type if known.encoding == "cdr" else ""


def bounds(recording: Recording, excerpt: Excerpt) -> tuple[int, int]:
    """The excerpt's first and last moment, in the recording's ns; RecordingError if it begins after the end."""
    begin = recording.begin + round(excerpt.start_offset * 1e9)
    if begin > recording.end:
        length = (recording.end - recording.begin) / 1e9
        raise RecordingError(f"start offset: invalid value {excerpt.start_offset:g}: expected at most {length:g} s")
    if excerpt.playback_duration is None:
        return begin, recording.end
    return begin, min(recording.end, begin + round(excerpt.playback_duration * 1e9))
