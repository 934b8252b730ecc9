"""Payload bytes become samples; whatever is wrong with them is a DecodeError that says what."""

from __future__ import annotations

import builtins
import json
import struct
from typing import Any

import cbor2
import numpy as np
import ormsgpack
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from contextpolicy.errors import DecodeError
from contextpolicy.policy.ros_types import type_store
from contextpolicy.policy.spec import Clock, Encoding, RosRelease, Stream
from contextpolicy.streams.attachment import attach, source_timestamp
from contextpolicy.streams.decoding import MAX_DEPTH, MAX_PAYLOAD, MAX_VALUES, Decoder, seconds

READING = {
    "gyro": [0.1, -0.2, 0.3],
    "speed": 0.5,
    "ok": True,
    "note": None,
    "id": "imu",
    "nested": {"a": [1, {"b": 2}]},
}
WRITERS = {"json": lambda value: json.dumps(value).encode(), "cbor": cbor2.dumps, "msgpack": ormsgpack.packb}


def decode(payload, encoding="json", **fields):
    return Decoder(Stream("imu", "robot/imu", Encoding(encoding), **fields)).decode(payload)


def refused(payload, encoding="json", **fields):
    with pytest.raises(DecodeError) as caught:
        decode(payload, encoding, **fields)
    message = str(caught.value)
    assert message.startswith(f"stream imu: the {encoding} payload ")
    assert len(message) < 300
    return message


@pytest.fixture(params=WRITERS)
def encoding(request):
    return request.param


class TestPlainEncodings:
    def test_a_map_is_the_samples_fields(self, encoding):
        sample = decode(WRITERS[encoding](READING), encoding)
        assert (sample.stream, sample.value, sample.timestamp) == ("imu", READING, None)

    @pytest.mark.parametrize("value", [3.5, "text", [1, 2], None, True])
    def test_what_is_no_map_is_read_as_value(self, encoding, value):
        assert decode(WRITERS[encoding](value), encoding).value == {"value": value}

    def test_too_many_bytes(self, encoding):
        message = refused(b" " * (MAX_PAYLOAD + 1), encoding)
        assert message.endswith(f"has {MAX_PAYLOAD + 1} bytes, allowed: {MAX_PAYLOAD}")

    def test_depth_is_bounded(self, encoding):
        value: object = 1
        for _ in range(MAX_DEPTH):
            value = [value]
        assert decode(WRITERS[encoding](value), encoding).value == {"value": value}
        assert "nests deeper" in refused(WRITERS[encoding]([value]), encoding)

    @pytest.mark.parametrize(
        "shape", [list, lambda items: {str(n): n for n in items}, lambda items: [[n] for n in items]]
    )
    def test_the_number_of_values_is_bounded(self, encoding, shape):
        assert "more than 10000 values" in refused(WRITERS[encoding](shape(range(MAX_VALUES))), encoding)

    def test_a_laser_scan_is_within_bounds(self, encoding):
        scan = {"ranges": [1.5] * 1440, "intensities": [0.5] * 1440}
        assert decode(WRITERS[encoding](scan), encoding).value == scan

    @pytest.mark.parametrize("cut", [0, 1, 5, 30])
    def test_a_truncated_payload(self, encoding, cut):
        refused(WRITERS[encoding](READING)[:cut], encoding)


class TestJson:
    @pytest.mark.parametrize("text", ["", "{", "nope", "{'a': 1}", "[1,]", '{"a": 1} x', "\ufeff{}"])
    def test_what_is_no_json(self, text):
        refused(text.encode())

    @pytest.mark.parametrize("constant", ["NaN", "Infinity", "-Infinity"])
    def test_json_has_no_such_number(self, constant):
        assert f"holds {constant}" in refused(f'{{"a": {constant}}}'.encode())

    def test_what_is_no_utf8(self):
        refused(b'{"a": "\xff"}')

    def test_a_bomb_of_brackets(self):
        refused(b"[" * MAX_PAYLOAD)
        refused(b'{"a":' * 200_000)

    def test_a_number_of_many_digits(self):
        refused(b"1" * 5000)
        assert decode(b"1" * 400).value == {"value": int("1" * 400)}

    @given(
        st.binary(max_size=40) | st.text(alphabet='{}[]",:0123456789.eE+-truefalsn\\ud8 ', max_size=30).map(str.encode)
    )
    @example(b'{"a": 1, "a": 2}')
    @example(b"18446744073709551616")
    @example(b"1e400")
    @example(b"-0.0")
    @example(rb'"\ud800"')
    @example(rb'{"a": "\ud83d\ude00\u0000"}')
    def test_it_is_read_as_the_standard_library_reads_it(self, payload):
        """Whatever reads it first: the same values of the same types, or no sample."""
        try:
            value = json.loads(payload.decode(), parse_constant=lambda _: 1 / 0)
        except (ValueError, ZeroDivisionError):
            refused(payload)
        else:
            fields = value if isinstance(value, dict) else {"value": value}
            assert repr(decode(payload).value) == repr(fields)

    def test_brackets_in_a_text_are_no_depth(self):
        assert decode(b'{"a": "' + b"[" * 1000 + b'"}').value == {"a": "[" * 1000}


class TestCbor:
    @pytest.mark.parametrize(
        ("payload", "why"),
        [
            pytest.param(b"\xf7", "UndefinedType", id="undefined"),
            pytest.param(b"\xc1\x1a\x65\x00\x00\x00", "datetime", id="date"),
            pytest.param(b"\xc4\x82\x1b\x00\x00\x00\x10\x00\x00\x00\x00\x01", "Decimal", id="huge decimal"),
            pytest.param(b"\xd8\x23\x64(a*)", "Pattern", id="regular expression"),
            pytest.param(b"\xa1\x01\x02", "has the key 1", id="key is a number"),
            pytest.param(b"\xa1\x81\x01\x02", "has the key (1,)", id="key is a list"),
            pytest.param(b"\xd8\x1c\x81\xd8\x1d\x00", "nests deeper", id="a list that holds itself"),
            pytest.param(b"\x9b\x00\x00\x00\x10\x00\x00\x00\x00", "premature end", id="claims 2^36 items"),
            pytest.param(b"\x5b\x00\x00\x00\x10\x00\x00\x00\x00", "premature end", id="claims 2^36 bytes"),
            pytest.param(b"\x62\xff\xff", "is broken", id="text is no UTF-8"),
        ],
    )
    def test_what_is_no_reading(self, payload, why):
        assert why in refused(payload, "cbor")

    def test_one_list_named_a_thousand_times_is_counted_a_thousand_times(self):
        shared = ["x"] * 500
        assert "more than 10000 values" in refused(cbor2.dumps([shared] * 500, value_sharing=True), "cbor")

    def test_nan_and_infinities_are_values(self):
        values = decode(cbor2.dumps([float("inf"), float("nan")]), "cbor").value["value"]
        assert values[0] == float("inf")
        assert values[1] != values[1]


class TestMsgpack:
    @pytest.mark.parametrize(
        "payload",
        [b"\xdd\xff\xff\xff\xff", b"\x81\x01\x02", b"\xc7\x01\x05a", b"\x91" * 2000, b"\xc1", b"\xa2\xff\xff"],
    )
    def test_what_is_no_reading(self, payload):
        refused(payload, "msgpack")


STORE = get_typestore(Stores.LATEST)


def message(name, /, **fields):
    """A ROS message; what is not given is zero."""
    made: dict[str, Any] = {}
    kind: Any
    detail: Any
    for field, (kind, detail) in STORE.fielddefs[name][1]:
        if field in fields:
            made[field] = fields[field]
        elif kind.name == "NAME":
            made[field] = message(detail)
        elif kind.name == "BASE":
            made[field] = {"string": "", "bool": False}.get(detail[0], 0)
        else:
            numeric = detail[0][0].name == "BASE" and detail[0][1][0] != "string"
            made[field] = np.zeros(detail[1], dtype=detail[0][1][0]) if numeric else []
    return STORE.types[name](**made)


def cdr(name, /, *, little_endian=True, **fields):
    return bytes(STORE.serialize_cdr(message(name, **fields), name, little_endian=little_endian))


def vector(x, y, z):
    return message("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


HEADER = message(
    "std_msgs/msg/Header",
    stamp=message("builtin_interfaces/msg/Time", sec=1763712350, nanosec=250_000_000),
    frame_id="imu_link",
)
IMU = "sensor_msgs/msg/Imu"


class TestCdr:
    @pytest.mark.parametrize("little_endian", [True, False])
    def test_a_message_is_nested_maps_of_plain_values(self, little_endian):
        payload = cdr(IMU, header=HEADER, angular_velocity=vector(0.1, 0.2, 0.3), little_endian=little_endian)
        sample = decode(payload, "cdr", type=IMU, timestamp="header.stamp")
        assert sample.timestamp == 1763712350.25
        assert sample.value["header"]["frame_id"] == "imu_link"
        assert sample.value["angular_velocity"] == {"x": 0.1, "y": 0.2, "z": 0.3}
        assert sample.value["orientation_covariance"] == [0.0] * 9
        assert type(sample.value["orientation_covariance"]) is list

    def test_a_laser_scan_keeps_its_infinities(self):
        ranges = np.array([1.0, np.inf, np.nan], dtype=np.float32)
        values = decode(cdr("sensor_msgs/msg/LaserScan", ranges=ranges), "cdr", type="sensor_msgs/msg/LaserScan").value
        assert values["ranges"][:2] == [1.0, float("inf")]
        assert all(type(value) is float for value in values["ranges"])

    def test_lists_of_messages_and_of_texts(self):
        joints = {"name": ["left", "right"], "position": np.array([0.5, 1.5])}
        values = decode(cdr("sensor_msgs/msg/JointState", **joints), "cdr", type="sensor_msgs/msg/JointState").value
        assert (values["name"], values["position"]) == (["left", "right"], [0.5, 1.5])
        status = message("diagnostic_msgs/msg/KeyValue", key="temperature", value="hot")
        payload = cdr("diagnostic_msgs/msg/DiagnosticStatus", values=[status], level=1)
        values = decode(payload, "cdr", type="diagnostic_msgs/msg/DiagnosticStatus").value
        assert values["values"] == [{"key": "temperature", "value": "hot"}]

    def test_a_picture_is_no_reading(self):
        picture = {"data": np.zeros(640 * 480, dtype=np.uint8)}
        text = refused(cdr("sensor_msgs/msg/Image", **picture), "cdr", type="sensor_msgs/msg/Image")
        assert "holds a list of 307200 values, allowed: 10000" in text

    def test_many_small_messages_are_counted_together(self):
        poses = [message("geometry_msgs/msg/Pose")] * 2000
        payload = cdr("geometry_msgs/msg/PoseArray", poses=poses)
        assert "more than 10000 values" in refused(payload, "cdr", type="geometry_msgs/msg/PoseArray")

    def test_every_truncation_is_refused(self):
        payload = cdr(IMU, header=HEADER)
        for length in range(len(payload) - 3):
            refused(payload[:length], "cdr", type=IMU)

    @pytest.mark.parametrize(
        "payload",
        [
            pytest.param(b"\x00\x01\x00\x00" + b"\xff" * 400, id="lengths of 2^32"),
            pytest.param(b"\x00\x09\x00\x00" + b"\x00" * 400, id="unknown encapsulation"),
            pytest.param(b'{"gyro": [1, 2, 3]}', id="json"),
            pytest.param(cdr("std_msgs/msg/String", data="hi"), id="another type"),
            pytest.param(cdr(IMU, header=HEADER) + b"\x00" * 8, id="too long"),
        ],
    )
    def test_what_is_no_such_message(self, payload):
        refused(payload, "cdr", type=IMU)

    def test_a_length_beyond_the_payload_is_not_believed(self):
        payload = bytearray(cdr("sensor_msgs/msg/LaserScan", ranges=np.zeros(4, dtype=np.float32)))
        payload[-24:-20] = struct.pack("<I", 2**31)
        refused(bytes(payload), "cdr", type="sensor_msgs/msg/LaserScan")

    def test_ones_own_messages_are_read_like_any(self):
        definitions = (
            ("my_msgs.msg.Mood.msg", "Note[] notes\nfloat32[2] pair"),
            ("my_msgs.msg.Note.msg", "string text"),
        )
        store = type_store(RosRelease.JAZZY, definitions)
        mood, note = store.types["my_msgs/msg/Mood"], store.types["my_msgs/msg/Note"]
        sent = mood(notes=[note(text="glad")], pair=np.array([1.0, np.inf], dtype=np.float32))
        payload = bytes(store.serialize_cdr(sent, "my_msgs/msg/Mood"))
        own = {"type": "my_msgs/msg/Mood", "ros": RosRelease.JAZZY, "types": "own", "definitions": definitions}
        assert decode(payload, "cdr", **own).value == {"notes": [{"text": "glad"}], "pair": [1.0, float("inf")]}

    def test_a_release_has_its_own_form_of_a_message(self):
        humble = get_typestore(Stores.ROS2_HUMBLE)
        sent = humble.types["sensor_msgs/msg/Range"](HEADER, 0, 0.5, 0.0, 4.0, 1.5)
        payload = bytes(humble.serialize_cdr(sent, "sensor_msgs/msg/Range"))
        assert decode(payload, "cdr", type="sensor_msgs/msg/Range", ros=RosRelease.HUMBLE).value["range"] == 1.5
        refused(payload, "cdr", type="sensor_msgs/msg/Range", ros=RosRelease.JAZZY)

    @pytest.mark.parametrize("little_endian", [True, False])
    def test_the_first_sample_finds_everything_made(self, monkeypatch, little_endian):
        """Making converters took 163 ms; the loop has other things to do."""
        payload = cdr("sensor_msgs/msg/Temperature", temperature=36.6, little_endian=little_endian)
        decoder = Decoder(Stream("t", "robot/t", Encoding.CDR, type="sensor_msgs/msg/Temperature"))
        monkeypatch.setattr(builtins, "compile", None)
        monkeypatch.setattr(builtins, "exec", None)
        monkeypatch.setattr(builtins, "__import__", None)
        sample = decoder.decode(payload)
        monkeypatch.undo()
        assert sample.value["temperature"] == 36.6

    def test_an_unknown_type_is_told_when_the_decoder_is_made(self):
        with pytest.raises(DecodeError, match="my_msgs/msg/Mood is no known ROS 2 message type"):
            Decoder(Stream("mood", "robot/mood", Encoding.CDR, type="my_msgs/msg/Mood"))


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
    def test_the_unit_is_told_by_the_magnitude(self, stamp):
        assert seconds(stamp) == pytest.approx(NOW, abs=1e-5)

    @pytest.mark.parametrize("stamp", [0, -5, 1.5])
    def test_small_numbers_are_seconds(self, stamp):
        assert seconds(stamp) == stamp

    @pytest.mark.parametrize("stamp", ["now", None, True, [1], {}, {"sec": 1}, {"sec": "1", "nanosec": 0}, "1" * 500])
    def test_what_is_no_timestamp(self, stamp):
        with pytest.raises(DecodeError, match="has the timestamp"):
            seconds(stamp)

    @pytest.mark.parametrize("stamp", [10**400, float("inf"), float("nan"), {"sec": 10**400, "nanosec": 0}, -(10**400)])
    def test_a_number_that_no_clock_shows_is_left_to_the_stream(self, stamp):
        assert isinstance(seconds(stamp), float)

    def test_it_is_found_by_its_path(self):
        assert decode(b'{"a": {"b": 12.5}}', timestamp="a.b").timestamp == 12.5

    @pytest.mark.parametrize("payload", [b"{}", b'{"a": {}}', b'{"a": 1}', b"5"])
    def test_a_sample_without_one_counts_without_one(self, payload):
        assert decode(payload, timestamp="a.b").timestamp is None

    def test_rmw_zenoh_says_when_a_sample_was_published(self):
        stamp, gid = 1_763_712_350_250_000_000, bytes(range(16))
        named = b"\x0fsequence_number%s\x10source_timestamp%s\x0asource_gid\x10%s"  # before 2025
        older = named % (struct.pack("<q", 7), struct.pack("<q", stamp), gid)
        assert source_timestamp(attach(7, stamp, gid)) == source_timestamp(older) == pytest.approx(NOW, abs=1e-6)

    @pytest.mark.parametrize("attachment", [b"", b"{}", bytes(33), bytes(77), b"x" * 33, b"x" * 77, b"x" * 10_000])
    def test_what_others_attach_is_no_time(self, attachment):
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
    def test_the_publication_counts_where_nobody_says_when_it_was_measured(self, encoding, fields, reads):
        given: dict[str, Any] = {"type": IMU} if encoding == "cdr" else {}
        assert Decoder(Stream("imu", "robot/imu", Encoding(encoding), **given, **fields)).reads_attachment is reads
