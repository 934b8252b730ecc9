"""Where an MCAP file has what, from its summary or, where that is missing or damaged, from the records themselves.

The mcap package reads records; what it can't do is to go on behind a damaged one (format: mcap.dev/spec). This file and
mcap_recording need the extra `mcap`, so they are loaded by the first MCAP file.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from dataclasses import dataclass, field
from io import BytesIO
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import breakup_chunk

from contextpolicy.streams.recorded_message import Damage, RecordingError, amount

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from contextpolicy.streams.recorded_message import Damages

MAGIC = b"\x89MCAP0\r\n"
REPAIR = "`mcap recover` (mcap.dev/guides/cli) writes what can be read into a new file"
LARGEST = 1 << 30
"""Bytes of a record: writers stop at a few MiB, and a damaged size must not take all memory."""
_HEAD = struct.Struct("<BQ")
_FOOTER = struct.Struct("<BQQQI")
"""Opcode, length, where the summary and its offsets start, and the checksum of all but that and the magic."""
_CHECKED = _FOOTER.size - 4
_BLOCK = 1 << 20
"""Bytes that are looked at together."""


class BrokenError(Exception):
    """A part of a file that can't be read; the message is the end of a sentence about it."""


class Piece(NamedTuple):
    """A record that holds messages, a chunk or a single message: times of the first and the last, and where it is."""

    begin: int
    end: int
    offset: int
    """Of its content, behind opcode and length."""
    size: int
    opcode: int
    channels: frozenset[int] | None = None
    """Those with messages in it; None if unknown."""


@dataclass(slots=True)
class Index:
    """All that has to be known before the messages are read. Times are in ns."""

    pieces: list[Piece] = field(default_factory=list)
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    begin: int = 0
    end: int = 0


def read_index(path: Path, damages: Damages) -> Index:
    """The index of a file; RecordingError if it is none, or can't be opened."""
    try:
        with path.open("rb") as file:
            size = file.seek(0, 2)
            _check_beginning(path, file, size)
            index = _read(path, file, size, damages)
    except OSError as error:
        raise RecordingError(f"{path} can't be read: {error.strerror or error}") from error
    index.pieces.sort(key=lambda piece: (piece.begin, piece.offset))
    return index


def content_of(file: BinaryIO, piece: Piece) -> list[McapRecord]:
    """The records in a piece, their checksum verified; BrokenError if they can't be read."""
    if piece.size > LARGEST:
        raise BrokenError(f"its length field says {piece.size} bytes")
    file.seek(piece.offset)
    content = file.read(piece.size)
    if len(content) < piece.size:
        raise BrokenError("is cut off")
    return _records(piece.opcode, content)


def _check_beginning(path: Path, file: BinaryIO, size: int) -> None:
    file.seek(0)
    if not size:
        raise RecordingError(
            f"{path} is empty: its recorder was stopped before it wrote anything; nothing was read, and"
            " nothing can be repaired"
        )
    if file.read(len(MAGIC)) != MAGIC:
        raise RecordingError(f"{path} is not an MCAP file: it does not start with MCAP's magic bytes; nothing was read")


def _read(path: Path, file: BinaryIO, size: int, damages: Damages) -> Index:
    try:
        index, problem = _from_summary(file, size), ""
    except BrokenError as error:
        index, problem = None, str(error)
    if index is not None:
        return index
    scan = Scan(file, size)
    # A file that is cut off has lost its summary as well.
    problem = scan.problem or problem
    if problem:
        read = amount(scan.index.counts.total(), scan.index.begin, scan.index.end)
        damages.add(Damage(str(path), problem, REPAIR, read))
    return scan.index


def _from_summary(file: BinaryIO, size: int) -> Index | None:
    """The index of a file whose summary has all that is needed; None if there is less."""
    _verify_summary(file, size)
    try:
        file.seek(0)
        summary = make_reader(file).get_summary()
    except Exception as error:
        raise BrokenError(f"has a damaged summary: {_reason(error)}") from error
    statistics = summary and summary.statistics
    if (
        not summary
        or not statistics
        or len(summary.channels) < statistics.channel_count
        or len(summary.schemas) < statistics.schema_count
    ):
        return None
    if len(summary.chunk_indexes) < statistics.chunk_count or not summary.chunk_indexes:
        return None
    pieces = [
        Piece(
            one.message_start_time,
            one.message_end_time,
            one.chunk_start_offset + _HEAD.size,
            max(one.chunk_length - _HEAD.size, 0),
            Opcode.CHUNK,
            frozenset(one.message_index_offsets) or None,
        )
        for one in summary.chunk_indexes
    ]
    counts = Counter(statistics.channel_message_counts)
    return Index(
        pieces, summary.channels, summary.schemas, counts, statistics.message_start_time, statistics.message_end_time
    )


def _verify_summary(file: BinaryIO, size: int) -> None:
    """BrokenError if the file does not end as it must, or its summary is not what its checksum is of."""
    end = size - len(MAGIC) - _FOOTER.size
    file.seek(max(end, 0))
    footer, magic = file.read(_FOOTER.size), file.read()
    if end < len(MAGIC) or magic != MAGIC or footer[0] != Opcode.FOOTER:
        raise BrokenError("has no end marker, as after a power cut")
    start, checksum = _FOOTER.unpack(footer)[2], _FOOTER.unpack(footer)[4]
    if start > end:
        raise BrokenError("has a damaged summary: it would begin after its end")
    if start and checksum and zlib.crc32(footer[:_CHECKED], _checksum(file, start, end)) != checksum:
        raise BrokenError("has a damaged summary: its checksum is wrong")


def _checksum(file: BinaryIO, start: int, end: int) -> int:
    """Of a part of a file, in blocks: by a damaged footer the summary can be as large as the file."""
    file.seek(start)
    checksum = 0
    while block := file.read(min(_BLOCK, end - file.tell())):
        checksum = zlib.crc32(block, checksum)
    return checksum


class Scan:
    """Reads a file from its beginning to its end, or to where no further record can be found."""

    def __init__(self, file: BinaryIO, size: int) -> None:
        self.index = Index()
        self.problem = ""
        """The first thing that is wrong."""
        self._file, self._size = file, size
        for opcode, offset, length in self._walk():
            if opcode in _READ:
                self._take(Piece(0, 0, offset, length, opcode))

    def _walk(self) -> Iterator[tuple[int, int, int]]:
        """Opcode, offset and length of each record's content, until the data end."""
        at, opcode = len(MAGIC), 0
        while opcode not in (Opcode.DATA_END, Opcode.FOOTER):
            self._file.seek(at)
            head = self._file.read(_HEAD.size)
            opcode, length = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, self._size)
            too_long = length > self._size - at - _HEAD.size
            if too_long or not opcode:  # there is no record of opcode 0
                self.problem = self.problem or f"is cut off or broken at byte {at} of {self._size}"
            if too_long:
                return
            if not any(head):
                at = self._behind_zeros(at)
                continue
            yield opcode, at + _HEAD.size, length
            at += _HEAD.size + length

    def _behind_zeros(self, at: int) -> int:
        """Where a hole that a power cut left ends: file systems fill what was never written with zeros."""
        self._file.seek(at)
        while block := self._file.read(_BLOCK):
            rest = block.lstrip(b"\0")
            if rest:
                return at + len(block) - len(rest)
            at += len(block)
        return at

    def _take(self, piece: Piece) -> None:
        try:
            records = content_of(self._file, piece)
            messages = [record for record in records if isinstance(record, Message)]
            self._learn(records)
            self._check(messages)
        except BrokenError as error:
            self.problem = self.problem or f"is damaged at byte {piece.offset - _HEAD.size}: {error}"
            return
        if messages:
            self._add(piece, messages)

    def _learn(self, records: Iterable[McapRecord]) -> None:
        for record in records:
            if isinstance(record, Channel):
                self.index.channels[record.id] = record
            elif isinstance(record, Schema):
                self.index.schemas[record.id] = record

    def _check(self, messages: Iterable[Message]) -> None:
        unknown = {message.channel_id for message in messages} - self.index.channels.keys()
        if unknown:
            raise BrokenError(f"a message refers to channel {min(unknown)}, which is not defined")

    def _add(self, piece: Piece, messages: list[Message]) -> None:
        index, times = self.index, [message.log_time for message in messages]
        begin, end, found = min(times), max(times), Counter(message.channel_id for message in messages)
        index.begin, index.end = (min(index.begin, begin), max(index.end, end)) if index.pieces else (begin, end)
        index.pieces.append(piece._replace(begin=begin, end=end, channels=frozenset(found)))
        index.counts.update(found)


_READ = {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK}


def _records(opcode: int, content: bytes) -> list[McapRecord]:
    stream = ReadDataStream(BytesIO(content))
    try:
        match opcode:
            case Opcode.SCHEMA:
                return [Schema.read(stream)]
            case Opcode.CHANNEL:
                return [Channel.read(stream)]
            case Opcode.MESSAGE:
                return [Message.read(stream, len(content))]
        chunk = Chunk.read(stream)
        if chunk.uncompressed_size > LARGEST:
            raise BrokenError(f"a chunk's length field says {chunk.uncompressed_size} bytes")  # noqa: TRY301 - a reason of its own
        return breakup_chunk(chunk, validate_crc=True)
    except BrokenError:
        raise
    except Exception as error:
        raise BrokenError(_reason(error)) from error


def _reason(error: Exception) -> str:
    """In one line: mcap's and the decompressors' own words, without what they print of the content."""
    text = str(error).partition("\n")[0]
    return (
        f"its checksum is wrong ({text[:60]})"
        if "crc" in text.lower()
        else f"{type(error).__name__} {text[:80]}".strip()
    )
