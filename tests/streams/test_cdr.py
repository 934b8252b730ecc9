"""Messages of ROS in CDR."""

from __future__ import annotations

import builtins
import struct
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from contextpolicy.errors import DecodeError
from contextpolicy.policy.ros_types import type_store
from contextpolicy.policy.stream_spec import Encoding, RosRelease, Stream
from contextpolicy.streams.decoding import Decoder
from tests.streams.payloads import IMU, decode, refused

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

    def test_an_image_is_refused(self):
        picture = {"data": np.zeros(640 * 480, dtype=np.uint8)}
        text = refused(cdr("sensor_msgs/msg/Image", **picture), "cdr", type="sensor_msgs/msg/Image")
        assert "holds a list of 307200 values: expected at most 10000" in text

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
    def test_unknown_messages_are_refused(self, payload):
        refused(payload, "cdr", type=IMU)

    def test_a_length_beyond_the_payload_is_refused(self):
        payload = bytearray(cdr("sensor_msgs/msg/LaserScan", ranges=np.zeros(4, dtype=np.float32)))
        payload[-24:-20] = struct.pack("<I", 2**31)
        refused(bytes(payload), "cdr", type="sensor_msgs/msg/LaserScan")

    def test_own_messages_are_decoded(self):
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
    def test_no_converters_are_built_for_the_first_sample(self, monkeypatch, little_endian):
        """Building the converters took 163 ms, in which the loop was blocked."""
        payload = cdr("sensor_msgs/msg/Temperature", temperature=36.6, little_endian=little_endian)
        decoder = Decoder(Stream("t", "robot/t", Encoding.CDR, type="sensor_msgs/msg/Temperature"))
        monkeypatch.setattr(builtins, "compile", None)
        monkeypatch.setattr(builtins, "exec", None)
        monkeypatch.setattr(builtins, "__import__", None)
        sample = decoder.decode(payload)
        monkeypatch.undo()
        assert sample.value["temperature"] == 36.6

    def test_an_unknown_type_is_reported_when_the_decoder_is_made(self):
        with pytest.raises(DecodeError, match="my_msgs/msg/Mood is not a known ROS 2 message type"):
            Decoder(Stream("mood", "robot/mood", Encoding.CDR, type="my_msgs/msg/Mood"))
