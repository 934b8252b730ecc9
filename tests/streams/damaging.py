"""Recordings, how they are damaged, and what is read of them."""

from __future__ import annotations

import random
import re

import pytest
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

from contextpolicy.streams.recorded_message import NO_DAMAGE, RecordingError
from contextpolicy.streams.recordings import DamageLog, Excerpt, open_recording

STORE = get_typestore(Stores.LATEST)
BEGIN = 1_795_300_000 * 10**9
COUNT, STEP = 200, 10**7
SENTENCE = re.compile(r"\d+ messages? (was|were) read, over \d+\.\d{3} s")


def write(path, compression=CompressionType.ZSTD, **options):
    """200 messages in two seconds, in chunks of about 20; payloads that do not compress well."""
    noise = random.Random(7)  # noqa: S311 - a test must repeat itself
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=2048, compression=compression, **options)
        writer.start()
        channel = writer.register_channel("robot/imu", "json", 0)
        for index in range(COUNT):
            at = BEGIN + index * STEP
            writer.add_message(channel, at, noise.randbytes(60).hex().encode(), at)
        writer.finish()
    return path


def read(path, *, skip=False):
    """How many messages there are, and the notes; the recording's own error if it is refused."""
    damages = DamageLog() if skip else NO_DAMAGE
    recording = open_recording(path, Excerpt(), damages)
    times = [message.at for message in recording.messages(recording.topics, recording.begin, recording.end)]
    assert times == sorted(times)
    return len(times), [*damages.notes]


def refusal(path, of=None):
    with pytest.raises(RecordingError) as refused:
        read(path)
    text = str(refused.value)
    assert text.startswith(str(of or path))
    assert "\n" not in text
    return text


def flipped(path, offset):
    content = bytearray(path.read_bytes())
    content[offset] ^= 0xFF
    path.write_bytes(content)
