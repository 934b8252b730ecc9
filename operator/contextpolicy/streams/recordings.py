"""Recordings of robots: MCAP files of any origin, and rosbag2 folders (MCAP or SQLite), read message by message.

Payloads are given as they were recorded, byte for byte; streams decode them as they would on the robot.
"""

from __future__ import annotations

import bisect
import struct
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple, Protocol

from contextpolicy.errors import ContextPolicyError
from contextpolicy.policy.key_expressions import selects
from contextpolicy.streams.timeline import RECORDED, Timeline, TimelineEntry

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from contextpolicy.policy.spec import Policy

CLOCK_TOPIC = "/clock"
"""Where simulators tell their time (rosgraph_msgs/msg/Clock)."""
DERIVED = "derivedFrom"
"""A channel with this in its metadata shows another one to viewers, and is no input."""
HASH = "TypeHashNotSupported"
"""The last chunk of rmw_zenoh's keys for a type whose hash is not known."""
_CLOCK = {1: struct.Struct("<iI"), 0: struct.Struct(">iI")}
"""By the second byte of the CDR header: little and big endian."""


class RecordingError(ContextPolicyError):
    """A recording that can't be read."""


class Topic(NamedTuple):
    """One topic of a recording. `encoding` is MCAP's word: cdr, json, cbor and so on; `type` is empty if unknown."""

    name: str
    encoding: str
    type: str
    messages: int


class Recorded(NamedTuple):
    """One message; `at` is in ns since 1970, or of simulated time."""

    at: int
    topic: str
    payload: bytes


class Recording(Protocol):
    """An open recording; `begin` and `end` are the times of its first and last message, in ns."""

    topics: dict[str, Topic]
    begin: int
    end: int

    def messages(self, topics: Iterable[str], begin: int, end: int) -> Iterator[Recorded]:
        """The messages of these topics from `begin` to `end`, both included, in the order of their times."""


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


def is_recording(path: Path) -> bool:
    """Whether a path is an MCAP file or a rosbag2 folder, by its name."""
    return path.suffix == ".mcap" or (path / "metadata.yaml").is_file()


def open_recording(path: Path, excerpt: Excerpt) -> Recording:
    """Open a recording, in simulated time if asked for; RecordingError says why it can't be read."""
    recording = McapFile(path) if path.suffix == ".mcap" else RosBag(path)
    return SimulatedTime(recording) if excerpt.use_sim_time else recording


class McapFile:
    """An MCAP file, whoever wrote it."""

    def __init__(self, path: Path) -> None:
        try:
            from mcap.exceptions import McapError  # noqa: PLC0415 - an extra
            from mcap.reader import make_reader  # noqa: PLC0415
        except ImportError as error:
            raise RecordingError(f"{path}: MCAP needs the package mcap: pip install 'contextpolicy[mcap]'") from error
        self._path = path
        try:
            with path.open("rb") as file:
                summary = make_reader(file).get_summary()
        except (OSError, McapError, struct.error) as error:
            raise RecordingError(f"{path}: cannot be read: {error or type(error).__name__}") from error
        if summary is None or summary.statistics is None or not summary.statistics.message_count:
            raise RecordingError(f"{path}: has no summary, or no message: `mcap recover` mends a file that was cut off")
        self.begin, self.end = summary.statistics.message_start_time, summary.statistics.message_end_time
        self.topics: dict[str, Topic] = {}
        for channel in summary.channels.values():
            schema = summary.schemas.get(channel.schema_id)
            count = summary.statistics.channel_message_counts.get(channel.id, 0)
            if DERIVED not in channel.metadata and count:
                before = self.topics[channel.topic].messages if channel.topic in self.topics else 0
                name = ros_type(schema.name if schema else "")
                self.topics[channel.topic] = Topic(channel.topic, channel.message_encoding, name, before + count)

    def messages(self, topics: Iterable[str], begin: int, end: int) -> Iterator[Recorded]:
        """In the order of their times: the file's index sorts them."""
        from mcap.exceptions import McapError  # noqa: PLC0415 - an extra
        from mcap.reader import make_reader  # noqa: PLC0415

        wanted = [topic for topic in topics if topic in self.topics]
        if not wanted:
            return
        try:
            with self._path.open("rb") as file:
                for _, channel, message in make_reader(file).iter_messages(wanted, starting_at=begin, ending_at=end):
                    if DERIVED not in channel.metadata:
                        yield Recorded(message.log_time, channel.topic, message.data)
        except (McapError, struct.error) as error:
            raise RecordingError(f"{self._path}: cannot be read: {error or type(error).__name__}") from error


class RosBag:
    """A folder that `ros2 bag record` wrote."""

    def __init__(self, path: Path) -> None:
        from rosbags.rosbag2 import Reader, ReaderError  # noqa: PLC0415 - slow to load

        self._path = path
        try:
            with Reader(path) as reader:
                self.begin, self.end = reader.start_time, reader.end_time - 1
                topics = [Topic(one.topic, "cdr", ros_type(one.msgtype), one.msgcount) for one in reader.connections]
                count = reader.message_count
        except (OSError, ReaderError) as error:
            raise RecordingError(f"{path}: cannot be read: {error}") from error
        if not count:
            raise RecordingError(f"{path}: has no message")
        self.topics = {topic.name: topic for topic in topics}

    def messages(self, topics: Iterable[str], begin: int, end: int) -> Iterator[Recorded]:
        """In the order of their times."""
        from rosbags.rosbag2 import Reader  # noqa: PLC0415 - slow to load

        wanted = set(topics)
        with Reader(self._path) as reader:
            connections = [connection for connection in reader.connections if connection.topic in wanted]
            for connection, at, payload in reader.messages(connections, begin, end + 1) if connections else ():
                yield Recorded(at, connection.topic, bytes(payload))


class SimulatedTime:
    """A recording by the clock of its simulator: each message has the time that `/clock` told last."""

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


def ros_type(name: str) -> str:
    """`sensor_msgs/Imu` as `sensor_msgs/msg/Imu`; other names as they are."""
    package, slash, kind = name.partition("/")
    return f"{package}/msg/{kind}" if slash and "/" not in kind else name


def rmw_key(topic: Topic, last: str = HASH) -> str:
    """The key on which rmw_zenoh publishes a topic in domain 0."""
    package, _, kind = topic.type.partition("/msg/")
    return f"0/{topic.name.strip('/')}/{package}::msg::dds_::{kind}_/{last}"


def timeline_key(topic: Topic) -> str:
    """rmw_zenoh's key for a topic of ROS 2, the topic itself for anything else."""
    return rmw_key(topic) if topic.encoding == "cdr" and "::msg::dds_::" not in topic.name else bridge_key(topic)


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
    recording: Recording, excerpt: Excerpt, key: Callable[[Topic], str], *, name: str, wanted: Sequence[str]
) -> Timeline:
    """The messages that the key expressions `wanted` select, as a timeline; of other topics, that they exist."""
    begin, end = bounds(recording, excerpt)
    keys = {topic.name: key(topic) for topic in recording.topics.values() if excerpt.wants(topic.name)}
    read = [topic for topic, named in keys.items() if any(selects(expression, named) for expression in wanted)]
    blank = TimelineEntry(0.0, 0.0, "", RECORDED, None, None, None, None)
    entries = [replace(blank, key=named) for topic, named in keys.items() if topic not in read]
    for message in recording.messages(read, begin, end):
        at = (message.at - begin) / 1e9
        entries.append(
            TimelineEntry(at, at, keys[message.topic], RECORDED, None, None, None, None, payload=message.payload)
        )
    return Timeline(name, max((end - begin) / 1e9, 1e-9), tuple(entries), begin=begin / 1e9)


def bounds(recording: Recording, excerpt: Excerpt) -> tuple[int, int]:
    """The excerpt's first and last moment, in the recording's ns; RecordingError if it begins after the end."""
    begin = recording.begin + round(excerpt.start_offset * 1e9)
    if begin > recording.end:
        length = (recording.end - recording.begin) / 1e9
        raise RecordingError(f"start offset {excerpt.start_offset:g} is not allowed: the recording has {length:g} s")
    if excerpt.playback_duration is None:
        return begin, recording.end
    return begin, min(recording.end, begin + round(excerpt.playback_duration * 1e9))
