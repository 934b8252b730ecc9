"""MCAP files of any writer: message by message in the order of their times, each chunk verified."""

from __future__ import annotations

import heapq
from typing import TYPE_CHECKING, BinaryIO

from mcap.records import Message

from contextpolicy.streams.mcap_index import REPAIR, BrokenError, Piece, content_of, read_index
from contextpolicy.streams.recorded_message import Damage, Recorded, Topic, amount, ros_type

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from mcap.records import Channel

    from contextpolicy.streams.recorded_message import Damages

DERIVED = "derivedFrom"
"""A channel with this in its metadata shows another one to viewers, and is not an input."""
HASH, QOS = "topic_type_hash", "offered_qos_profiles"
"""What rosbag2 writes into a channel's metadata."""


class McapRecording:
    """An open file; `damages` hears of each part that can't be read, which is then left out."""

    def __init__(self, path: Path, damages: Damages) -> None:
        self._path, self._damages = path, damages
        self._index = read_index(path, damages)
        self.begin, self.end = self._index.begin, self._index.end
        self.topics: dict[str, Topic] = {}
        for channel in self._index.channels.values():
            count = self._index.counts[channel.id]
            if DERIVED not in channel.metadata and count:
                before = self.topics[channel.topic].messages if channel.topic in self.topics else 0
                self.topics[channel.topic] = self._topic(channel, before + count)

    def messages(self, topics: Iterable[str], begin: int, end: int) -> Iterator[Recorded]:
        """In the order of their times: what chunks that overlap hold is merged."""
        names = set(topics)
        wanted = {
            number: channel.topic
            for number, channel in self._index.channels.items()
            if channel.topic in names and DERIVED not in channel.metadata
        }
        pieces = [piece for piece in self._index.pieces if _may_hold(piece, wanted.keys(), begin, end)]
        waiting: list[tuple[int, int, int, Recorded]] = []
        read = 0
        with self._path.open("rb") as file:
            for piece in pieces:
                while waiting and waiting[0][0] < piece.begin:
                    yield heapq.heappop(waiting)[-1]
                found = self._messages(file, piece, read)
                read += len(found)
                for place, message in enumerate(found):
                    if message.channel_id in wanted and begin <= message.log_time <= end:
                        recorded = Recorded(message.log_time, wanted[message.channel_id], message.data)
                        heapq.heappush(waiting, (message.log_time, piece.offset, place, recorded))
        while waiting:
            yield heapq.heappop(waiting)[-1]

    def _messages(self, file: BinaryIO, piece: Piece, read: int) -> list[Message]:
        """Those in a piece; none if it is damaged. `read` is how many messages were before it."""
        try:
            return [record for record in content_of(file, piece) if isinstance(record, Message)]
        except BrokenError as error:
            what = f"is damaged at byte {piece.offset}, in a part of {piece.size} bytes: {error}"
            self._damages.add(Damage(str(self._path), what, REPAIR, amount(read, self.begin, piece.begin)))
            return []

    def _topic(self, channel: Channel, count: int) -> Topic:
        schema, about = self._index.schemas.get(channel.schema_id), channel.metadata
        definition = schema.data.decode(errors="replace") if schema and schema.encoding == "ros2msg" else ""
        name = ros_type(schema.name if schema else "")
        encoding = channel.message_encoding
        return Topic(channel.topic, encoding, name, count, about.get(HASH, ""), definition, about.get(QOS, ""))


def _may_hold(piece: Piece, channels: Iterable[int], begin: int, end: int) -> bool:
    known = piece.channels is None or not piece.channels.isdisjoint(channels)
    return known and piece.end >= begin and piece.begin <= end
