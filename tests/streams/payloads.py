"""Payloads as senders write them."""

from __future__ import annotations

import json

import cbor2
import ormsgpack
import pytest

from contextpolicy.errors import DecodeError
from contextpolicy.policy.stream_spec import Encoding, Stream
from contextpolicy.streams.decoding import Decoder

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


IMU = "sensor_msgs/msg/Imu"
