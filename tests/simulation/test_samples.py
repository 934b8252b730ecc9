"""Timeline values become the very samples that the player's payloads become, without a payload for each."""

from __future__ import annotations

import json
from collections import Counter
from unittest.mock import Mock

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.errors import DecodeError
from contextpolicy.policy.spec import Policy
from contextpolicy.policy.stream_spec import Stream
from contextpolicy.simulation.epoch import EPOCH
from contextpolicy.simulation.samples import Skipped, samples
from contextpolicy.streams import timeline
from contextpolicy.streams.decoding import Decoder

STREAM = Stream("imu", "imu", timestamp="stamp")

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text() | st.just("stamp"), inner, max_size=4),
    max_leaves=20,
)


POLICY = Policy("lab", "robot", (), streams=(STREAM,))


def read(*inputs, duration=10.0):
    line = timeline.parse({"name": "t", "duration": duration, "inputs": list(inputs)})
    drops: Counter[tuple[str, str]] = Counter()
    skipped = Skipped()
    return list(samples(POLICY, line.inputs(), skipped, drops)), skipped, drops


def repeated(value, *, rate=100):
    return {"key": "imu", "encoding": "json", "from": 0, "to": 1, "rate": rate, "value": value}


def decoded(value, at):
    """As the robot does it: a payload, then a decoder."""
    stamped = {"stamp": EPOCH * 10**9 + round(at * 1e9), **value} if isinstance(value, dict) else value
    try:
        return Decoder(STREAM).decode(json.dumps(stamped).encode())
    except DecodeError:
        return None


@given(VALUES.filter(lambda value: value is not None))
def test_samples_match_the_robots_decoder(value):
    found, _, drops = read(repeated(value, rate=3))
    expected = [(at, sample) for at in (0.0, 1 / 3, 2 / 3) if (sample := decoded(value, at)) is not None]
    assert found == expected
    assert sum(drops.values()) == 3 - len(expected)


def test_a_repeated_value_is_encoded_once(monkeypatch: pytest.MonkeyPatch) -> None:
    encode = Mock(wraps=msgspec.json.encode)
    monkeypatch.setattr("contextpolicy.simulation.samples.msgspec.json.encode", encode)
    found, _, _ = read(repeated({"gyro": [0.1, 0.0, 0.0]}))
    assert len(found) == 100
    assert encode.call_count == 1


@pytest.mark.parametrize(
    ("value", "wanted"),
    [
        ([[[0]] * 5000, 1], "stream imu: the json payload holds more than 10000 values"),
        ({"stamp": "noon"}, "stream imu: the json payload has the timestamp 'noon': expected a number, or a map of"),
        (1e999, "stream imu: the json payload holds Infinity, which is not a JSON number"),
    ],
)
def test_decoder_errors_are_quoted_and_counted(value, wanted):
    found, skipped, drops = read(repeated(value, rate=5))
    assert found == []
    (message,) = skipped.undecodable
    assert message.startswith(wanted)
    assert skipped.undecodable[message] == 5
    assert drops == {("imu", "undecodable"): 5}
