"""An MCAP file that grows message by message. Topics of ROS are as `ros2 bag` writes them, others are Zenoh keys."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Self

from mcap.data_stream import RecordBuilder
from mcap.records import Header
from mcap.writer import CompressionType, Writer

from timelines.recording.channels import Channel, channel_of, counted, drawn
from timelines.recording.foxglove import shown
from timelines.recording.ros_topics import RosTopics

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

MIXED, ROS = Header(profile="", library="contextpolicy bus"), Header(profile="ros2", library="contextpolicy")
"""How a file begins: of equal length, so that one can replace the other when it is known what the file holds. By the
profile `ros2` all messages are CDR (mcap.dev/spec/registry), and rosbags reads no other file."""


class McapWriter:
    """Writes one file; use it in a `with` block, from one thread. `header` is how it begins, until it is closed."""

    def __init__(self, path: Path, topics: RosTopics | None = None, header: Header = MIXED) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("wb")
        self._writer = Writer(self._file, compression=CompressionType.ZSTD)
        self._writer.start(profile=header.profile, library=header.library)
        self._topics = topics or RosTopics()
        self._channels: dict[Channel, int] = {}
        self._schemas: dict[tuple[str, str], int] = {}
        self._keys: dict[tuple[str, str], Channel] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def mixed(self) -> bool:
        """Whether there is anything beside ROS topics: then tools of ROS do not open the file."""
        encodings = {channel.encoding for channel in self._channels}
        return "cdr" in encodings and len(encodings) > 1

    def close(self) -> None:
        """Finish the file."""
        with self._file:
            self._writer.finish()  # type: ignore[no-untyped-call]
            if self._channels and not self.mixed and next(iter(self._channels)).encoding == "cdr":
                self._file.seek(8)  # behind the magic
                self._file.write(_bytes(ROS))

    def heard(self, key: str, encoding: str, payload: bytes, *, received: int, stamp: int) -> None:
        """Write a message of the bus as it is, and what a viewer can draw of it; times are in ns since 1970."""
        channel = self._keys.get((key, encoding))
        if channel is None:
            channel = self._keys[key, encoding] = channel_of(key, encoding, self._topics)
        self._writer.add_message(self._number(channel), received, payload, stamp)
        for one in shown(key, channel.encoding, payload, stamp):
            self._writer.add_message(self._number(drawn(one, key)), received, json.dumps(one.value).encode(), stamp)

    def counted(self, topic: str, schema: str, value: Mapping[str, Any], at: int) -> None:
        """Write a measurement that was never on the bus."""
        self._writer.add_message(self._number(counted(topic, schema)), at, json.dumps(value).encode(), at)

    def attach(self, name: str, media_type: str, content: bytes, at: int) -> None:
        """Add a whole file, such as the timeline."""
        self._writer.add_attachment(at, at, name, media_type, content)

    def describe(self, about: Mapping[str, str], name: str = "contextpolicy") -> None:
        """Say what the recording is of."""
        self._writer.add_metadata(name, dict(about))

    def _number(self, channel: Channel) -> int:
        if channel not in self._channels:
            self._channels[channel] = self._writer.register_channel(
                channel.topic, channel.encoding, self._schema(channel), dict(channel.metadata)
            )
        return self._channels[channel]

    def _schema(self, channel: Channel) -> int:
        """A schema without text still names the type: rosbag2 takes it from there."""
        if not channel.schema:
            return 0
        known = channel.schema, channel.text
        if known not in self._schemas:
            self._schemas[known] = self._writer.register_schema(channel.schema, channel.language, channel.text.encode())
        return self._schemas[known]


def _bytes(header: Header) -> bytes:
    builder = RecordBuilder()
    header.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]
