"""The timestamp of a sample."""

from __future__ import annotations

import struct
from typing import Any

import pytest

from contextpolicy.errors import DecodeError
from contextpolicy.policy.stream_spec import Clock, Encoding, Stream
from contextpolicy.streams.attachment import attach, source_timestamp
from contextpolicy.streams.decoding import Decoder, seconds
from tests.streams.payloads import IMU, decode

NOW = 1763712350.25


class TestTimestamps:
    @pytest.mark.parametrize(
        "stamp",
        [
            NOW,
            int(NOW * 1e3),
            int(NOW * 1e6),
            int(NOW * 1e9),
            NOW * 1e9,
            {"sec": 1763712350, "nanosec": 250_000_000},
            {"sec": 1763712350, "nanosec": 250_000_000, "more": 1},
        ],
    )
    def test_the_unit_follows_from_the_magnitude(self, stamp):
        assert seconds(stamp) == pytest.approx(NOW, abs=1e-5)

    @pytest.mark.parametrize("stamp", [0, -5, 1.5])
    def test_small_numbers_are_seconds(self, stamp):
        assert seconds(stamp) == stamp

    @pytest.mark.parametrize("stamp", ["now", None, True, [1], {}, {"sec": 1}, {"sec": "1", "nanosec": 0}, "1" * 500])
    def test_a_non_timestamp_is_refused(self, stamp):
        with pytest.raises(DecodeError, match="has the timestamp"):
            seconds(stamp)

    @pytest.mark.parametrize("stamp", [10**400, float("inf"), float("nan"), {"sec": 10**400, "nanosec": 0}, -(10**400)])
    def test_an_implausible_number_is_still_a_timestamp(self, stamp):
        assert isinstance(seconds(stamp), float)

    def test_it_is_found_by_its_path(self):
        assert decode(b'{"a": {"b": 12.5}}', timestamp="a.b").timestamp == 12.5

    @pytest.mark.parametrize("payload", [b"{}", b'{"a": {}}', b'{"a": 1}', b"5"])
    def test_a_sample_without_a_timestamp_is_accepted(self, payload):
        assert decode(payload, timestamp="a.b").timestamp is None

    def test_rmw_zenoh_attachments_give_the_publication_time(self):
        stamp, gid = 1_763_712_350_250_000_000, bytes(range(16))
        named = b"\x0fsequence_number%s\x10source_timestamp%s\x0asource_gid\x10%s"  # before 2025
        older = named % (struct.pack("<q", 7), struct.pack("<q", stamp), gid)
        assert source_timestamp(attach(7, stamp, gid)) == source_timestamp(older) == pytest.approx(NOW, abs=1e-6)

    @pytest.mark.parametrize("attachment", [b"", b"{}", bytes(33), bytes(77), b"x" * 33, b"x" * 77, b"x" * 10_000])
    def test_foreign_attachments_are_not_timestamps(self, attachment):
        assert source_timestamp(attachment) is None

    @pytest.mark.parametrize(
        ("encoding", "fields", "reads"),
        [
            ("cdr", {}, True),
            ("cdr", {"timestamp": "header.stamp"}, False),
            ("cdr", {"clock": Clock.ARRIVAL}, False),
            ("json", {}, False),
        ],
    )
    def test_publication_time_is_used_without_a_measurement_time(self, encoding, fields, reads):
        given: dict[str, Any] = {"type": IMU} if encoding == "cdr" else {}
        assert Decoder(Stream("imu", "robot/imu", Encoding(encoding), **given, **fields)).reads_attachment is reads
