"""A damaged recording is refused with what is wrong, how much was read and what repairs it, or read to the damage."""

from __future__ import annotations

import struct
from io import BytesIO

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.writer import CompressionType, IndexType

from contextpolicy.streams.mcap_index import LARGEST, BrokenError, Piece, Scan, _verify_summary, content_of
from contextpolicy.streams.recorded_message import RecordingError
from tests.fuzz import targets
from tests.streams.damaging import COUNT, SENTENCE, flipped, read, refusal, write


def chunks(content):
    """Offset and length of each chunk's content."""
    at = 8
    while at < len(content) - 8:
        opcode, length = struct.unpack_from("<BQ", content, at)
        if opcode == 6:
            yield at + 9, length
        at += 9 + length


def test_an_undamaged_file_gives_no_notes(tmp_path):
    assert read(write(tmp_path / "run.mcap")) == (COUNT, [])


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4, CompressionType.NONE])
def test_a_flipped_byte_in_a_chunk_costs_that_chunk(tmp_path, compression):
    path = write(tmp_path / "run.mcap", compression)
    start, length = list(chunks(path.read_bytes()))[2]
    flipped(path, start + length - 40)
    text = refusal(path)
    assert "is damaged at byte" in text
    assert SENTENCE.search(text)
    assert "`mcap recover`" in text
    assert "--skip-damaged" in text
    count, notes = read(path, skip=True)
    assert COUNT - 40 <= count < COUNT
    assert len(notes) == 1


def test_a_wrong_checksum_of_an_uncompressed_chunk_is_noticed(tmp_path):
    path = write(tmp_path / "run.mcap", CompressionType.NONE)
    start, _ = next(chunks(path.read_bytes()))
    flipped(path, start + 24)  # behind two times and a size
    assert "checksum is wrong" in refusal(path)


@pytest.mark.parametrize("part", [0.1, 0.5, 0.9])
def test_a_truncated_file_is_read_up_to_the_cut(tmp_path, part):
    path = write(tmp_path / "run.mcap")
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * part)])
    text = refusal(path)
    assert "is cut off or broken at byte" in text
    assert SENTENCE.search(text)
    count, notes = read(path, skip=True)
    assert COUNT * (part - 0.15) < count < COUNT
    assert len(notes) == 1


def test_a_file_without_its_last_bytes_has_all_its_messages(tmp_path):
    path = write(tmp_path / "run.mcap")
    path.write_bytes(path.read_bytes()[:-3])
    assert f"{COUNT} messages were read" in refusal(path)
    assert read(path, skip=True)[0] == COUNT


def test_a_record_of_impossible_length_is_reported(tmp_path):
    path = write(tmp_path / "run.mcap")
    content = bytearray(path.read_bytes())
    start, _ = list(chunks(content))[3]
    content[start - 8 : start] = struct.pack("<Q", 14496609109943703477)
    path.write_bytes(content[:-40])  # and the summary does not help
    text = refusal(path)
    assert f"is cut off or broken at byte {start - 9} of" in text
    assert "14496609109943703477" not in text
    assert 0 < read(path, skip=True)[0] < COUNT


def test_a_damaged_summary_costs_no_message(tmp_path):
    path = write(tmp_path / "run.mcap")
    flipped(path, path.stat().st_size - 80)
    text = refusal(path)
    assert "has a damaged summary" in text
    assert f"{COUNT} messages were read" in text
    assert read(path, skip=True)[0] == COUNT


@pytest.mark.parametrize(
    "options",
    [
        {"use_statistics": False},
        {"repeat_channels": False},
        {"index_types": IndexType.NONE},
        {"use_chunking": False},
        {
            "index_types": IndexType.NONE,
            "repeat_channels": False,
            "repeat_schemas": False,
            "use_statistics": False,
            "use_summary_offsets": False,
        },
    ],
    ids="-".join,
)
def test_a_valid_file_without_all_of_a_summary_is_read(tmp_path, options):
    assert read(write(tmp_path / "run.mcap", **options)) == (COUNT, [])


def test_a_chunk_that_claims_to_be_huge_takes_no_memory(tmp_path):
    path = write(tmp_path / "run.mcap", CompressionType.NONE)
    content = bytearray(path.read_bytes())
    start, _ = next(chunks(content))
    content[start + 16 : start + 24] = struct.pack("<Q", 1 << 60)
    path.write_bytes(content)
    assert "a chunk's length field says 1152921504606846976 bytes" in refusal(path)


@pytest.mark.parametrize("opcode", [Opcode.MESSAGE, Opcode.CHUNK])
def test_a_record_that_claims_to_be_huge_takes_no_memory(opcode):
    file = Reads(b"short")
    with pytest.raises(BrokenError, match=f"its length field says {LARGEST + 1} bytes"):
        content_of(file, Piece(0, 0, 0, LARGEST + 1, opcode))
    assert file.count == 0


def test_a_summary_that_claims_to_be_the_whole_file_is_checked_in_blocks(tmp_path, monkeypatch):
    path = write(tmp_path / "run.mcap")
    content = bytearray(path.read_bytes())
    struct.pack_into("<Q", content, len(content) - 28, 8)  # where the summary begins: right behind the magic
    file = Reads(content)
    monkeypatch.setattr("contextpolicy.streams.mcap_index._BLOCK", 1000)
    with pytest.raises(BrokenError, match="its checksum is wrong"):
        _verify_summary(file, len(content))
    assert file.most <= 1000


class Reads(BytesIO):
    """A file that counts how often it is read, and how many bytes at most."""

    count = most = 0

    def read(self, size=-1, /):
        self.count += 1
        content = super().read(size)
        self.most = max(self.most, len(content))
        return content


HOLE = 8 << 20


def test_a_tail_of_zeros_is_passed_over_at_once(tmp_path):
    """As some file systems leave it after a power cut; the summary is lost with it."""
    content = write(tmp_path / "run.mcap").read_bytes()
    start, length = list(chunks(content))[3]
    file = Reads(content[: start + length] + bytes(HOLE))
    scan = Scan(file, start + length + HOLE)
    assert scan.problem == f"is cut off or broken at byte {start + length} of {start + length + HOLE}"
    assert scan.index.counts.total() > 0
    assert file.count < 100


@pytest.mark.parametrize("size", [9, 10, 4096])
def test_reading_continues_behind_a_hole_of_zeros(tmp_path, size):
    path = write(tmp_path / "run.mcap")
    content = path.read_bytes()
    start, length = list(chunks(content))[3]
    end = start + length
    path.write_bytes(content[:end] + bytes(size) + content[end:-40])
    assert f"is cut off or broken at byte {end} of" in refusal(path)
    assert read(path, skip=True)[0] == COUNT


def test_a_record_of_opcode_zero_is_noticed(tmp_path):
    path = write(tmp_path / "run.mcap")
    content = bytearray(path.read_bytes())
    start, _ = list(chunks(content))[3]
    content[start - 9] = 0
    path.write_bytes(content[:-40])
    assert f"is cut off or broken at byte {start - 9} of" in refusal(path)
    assert 0 < read(path, skip=True)[0] < COUNT


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"not mcap", "is not an MCAP file"),
        (b"\x89MCAP0\r\n", "is cut off or broken at byte 8 of 8; 0 messages were read"),
        (b"\x89MCAP0\r\n" * 3, "0 messages were read"),
    ],
)
def test_a_file_without_messages_is_refused(tmp_path, content, words):
    path = tmp_path / "run.mcap"
    path.write_bytes(content)
    assert words in refusal(path)
    with pytest.raises(RecordingError):
        read(path, skip=True)


def test_a_missing_file_is_refused(tmp_path):
    assert "No such file" in refusal(tmp_path / "run.mcap")
    assert "can't be read" in refusal(tmp_path / "run.db3")


@settings(max_examples=150)
@given(data=st.data())
def test_arbitrary_damage_never_crashes_the_reader(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("fuzz")
    compression = data.draw(st.sampled_from(list(CompressionType)))
    path = write(folder / "run.mcap", compression, use_chunking=data.draw(st.booleans()))
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(content) - 1))
        match data.draw(st.sampled_from(["change", "remove", "insert", "cut"])):
            case "change":
                content[at] = data.draw(st.integers(0, 255))
            case "remove":
                del content[at : at + data.draw(st.integers(1, 64))]
            case "insert":
                content[at:at] = data.draw(st.binary(min_size=1, max_size=16))
            case "cut":
                del content[max(at, 1) :]
    targets.recording(bytes(content))
