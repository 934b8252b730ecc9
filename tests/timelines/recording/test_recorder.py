"""What was on the bus is in the file, plays again as it was heard, and can be drawn."""

from __future__ import annotations

import base64
import errno
import json
import math
import os
import threading

import pytest
from mcap.reader import make_reader

from contextpolicy.policy.ros_types import type_store
from contextpolicy.streams.recorded_message import NO_DAMAGE
from contextpolicy.streams.recordings import Excerpt, timeline_key
from contextpolicy.streams.timeline import parse
from robotkit.stereo import StereoFrame, encode
from tests.modules.robotkit.bus import Matching, client, router
from tests.waiting import until
from timelines.recording.foxglove import schema_of, shown
from timelines.recording.mcap_file import McapWriter
from timelines.recording.recorder import BusRecorder, encoding_of, targets
from timelines.replay.player import Options, TimelineInputs, _window, publish
from timelines.replay.recorded import RecordedInputs

SCAN = "0/scan/sensor_msgs::msg::dds_::LaserScan_/TypeHashNotSupported"
TIMELINE = parse(
    {
        "name": "short",
        "duration": 1.0,
        "inputs": [
            {"key": "robot/imu", "encoding": "json", "from": 0, "to": 1, "rate": 20, "value": {"speed": 0.3}},
            {
                "key": SCAN,
                "encoding": "cdr",
                "type": "sensor_msgs/msg/LaserScan",
                "from": 0,
                "to": 1,
                "rate": 10,
                "value": {"ranges": [1.5]},
            },
        ],
    }
)
PLAN = {
    "policy": "robot/p",
    "contexts": ["moving"],
    "cause": "imu",
    "tasks": {"slam": {"share": 1.5, "weight": 4.0}},
    "nodes": {"robot": {"tasks": {"slam": 1.5}}},
    "targets": [{"task": "slam", "containerId": "containerd://ab"}, {"task": "old", "containerId": None}],
}


TURN = b'{"start_angle": 0.5, "end_angle": 1.25, "ranges": [1, 2]}'
JPEG = b"\xff\xd8\xff\xe0"


def read(path):
    with path.open("rb") as file:
        return [(channel, message) for _, channel, message in make_reader(file).iter_messages()]


def test_a_recording_replays_identical_payloads(tmp_path, cgroup):
    path = tmp_path / "run.mcap"
    with (
        router() as address,
        client(address) as player,
        client(address) as listener,
        McapWriter(path) as file,
        BusRecorder(listener, file, {"slam": cgroup}),
    ):
        with player.declare_publisher("robot/imu") as publisher:
            Matching(publisher).wait(expected=True)
        publish(TimelineInputs(TIMELINE), player, stop=threading.Event(), options=Options(rate=2))
    heard = read(path)
    imu = [message.data for channel, message in heard if channel.topic == "robot/imu"]
    assert len(imu) >= 15  # a busy machine's bus may drop some
    assert json.loads(imu[0])["speed"] == 0.3
    counters = [json.loads(message.data) for channel, message in heard if channel.topic == "cgroup/slam"]
    assert counters[0] == {"limit": 0.5, "usage": 2.0, "periods": 9.0, "throttled": 3.0, "throttledTime": 0.5}
    inputs = RecordedInputs(path, Excerpt(topics=["robot/imu", "scan"]), timeline_key, NO_DAMAGE)
    scan = SCAN.replace("TypeHashNotSupported", type_store().hash_rihs01("sensor_msgs/msg/LaserScan"))
    assert inputs.encodings == {"robot/imu": "json", scan: "cdr"}
    again = list(inputs.timed(0))
    assert [payload for _, key, payload in again if key == "robot/imu"] == imu
    assert [at for at, _, _ in again] == sorted(at for at, _, _ in again)
    assert len(list(inputs.timed(0.2))) < len(again)
    assert len(list(_window(inputs, Options()))) == len(again)


class Full:
    """A file on a disk that is full."""

    def heard(self, *_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    counted = heard


def test_a_recording_that_cannot_be_written_is_an_error(cgroup):
    def record(listener):
        with BusRecorder(listener, Full(), {"slam": cgroup}) as recorder:
            until(lambda: not recorder._thread.is_alive())

    with router() as address, client(address) as listener, pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
        record(listener)


def test_the_file_has_metadata_and_attachments(tmp_path):
    with McapWriter(tmp_path / "run.mcap") as file:
        file.describe({"timeline": "demo"})
        file.attach("demo.json", "application/json", b"{}", 5)
        file.counted("cgroup/slam", "cgroup", {"limit": 1.0}, 7)
    with (tmp_path / "run.mcap").open("rb") as opened:
        reader = make_reader(opened)
        assert next(reader.iter_metadata()).metadata == {"timeline": "demo"}
        assert next(reader.iter_attachments()).data == b"{}"


def test_ros_messages_have_their_definition(tmp_path):
    with McapWriter(tmp_path / "run.mcap") as file:
        for key in (SCAN, "0/x/my_robot::msg::dds_::Own_/RIHS01_ab"):
            file.heard(key, "cdr", b"\x00\x01\x00\x00", received=1, stamp=1)
    with (tmp_path / "run.mcap").open("rb") as opened:
        scan, own = (schema for schema, _, _ in make_reader(opened).iter_messages())
    assert scan is not None
    assert (scan.name, scan.encoding) == ("sensor_msgs/msg/LaserScan", "ros2msg")
    assert b"float32[] ranges" in scan.data
    assert b"MSG: std_msgs/Header" in scan.data
    assert b"time stamp" not in scan.data  # as ROS 1 has it
    assert own is not None
    assert (own.name, own.encoding, own.data) == ("my_robot/msg/Own", "", b"")


@pytest.mark.parametrize(
    ("key", "payload", "schema", "field", "value"),
    [
        ("robot/lidar/scan", b'{"ranges": [1, 0, 2.5]}', "foxglove.LaserScan", "ranges", [1.0, 1e6, 2.5]),
        ("robot/lidar/scan", b'{"ranges": [1, 0, 2.5, 1]}', "foxglove.LaserScan", "end_angle", 1.5 * math.pi),
        ("robot/lidar/scan", TURN, "foxglove.LaserScan", "start_angle", 0.5),
        ("robot/lidar/scan", TURN, "foxglove.LaserScan", "end_angle", 1.25),
        (
            "robot/slam/pose",
            b'{"position": [1, 2, 3], "orientation": [0, 0, 0, 1]}',
            "foxglove.PoseInFrame",
            "pose",
            {"position": {"x": 1, "y": 2, "z": 3}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}},
        ),
        ("robot/camera/side", JPEG, "foxglove.CompressedImage", "data", base64.b64encode(JPEG).decode()),
        ("robot/camera/side", b"\x89PNG", "foxglove.CompressedImage", "format", "png"),
        ("robot/microphone", b"\x01\x00", "foxglove.RawAudio", "sample_rate", 16000),
        ("contextpolicy/robot/p/plan", json.dumps(PLAN).encode(), "foxglove.Log", "message", "moving; imu; slam 1.5"),
        ("robot/camera/stereo", encode(StereoFrame(1, b"\x89PNG", b"")), "foxglove.CompressedImage", "format", "png"),
    ],
)
def test_viewers_get_standard_schemas(key, payload, schema, field, value):
    drawn, *_ = shown(key, "", payload, 1_500_000_007)
    assert (drawn.schema, drawn.value[field]) == (schema, value)
    assert drawn.value["timestamp"] == {"sec": 1, "nsec": 500_000_007}
    assert drawn.value.keys() == schema_of(schema)["properties"].keys()


@pytest.mark.parametrize("payload", [b"", b"{", b"[]", b"null", b'{"ranges": 7}', b'{"position": []}', b'{"tasks": 1}'])
@pytest.mark.parametrize("key", ["a/lidar/scan", "a/slam/pose", "a/camera/stereo", "contextpolicy/a/b/plan"])
def test_invalid_payloads_are_not_drawn(key, payload):
    assert list(shown(key, "json", payload, 0)) == []


@pytest.mark.parametrize(("key", "payload"), [("a/microphone", b"odd"), ("a/camera/side", b"\x00\x01\x00\x00")])
def test_payloads_of_other_formats_are_not_drawn(key, payload):
    assert list(shown(key, "zenoh/bytes", payload, 0)) == []


def test_containers_are_those_of_the_plan():
    assert list(targets(json.dumps(PLAN).encode())) == [("slam", "containerd://ab")]
    assert [list(targets(payload)) for payload in (b"", b"[]", b"7", b'{"targets": [{}, 1]}')] == [[], [], [], []]


def test_encodings_use_mcaps_names():
    assert encoding_of("application/json", "a", b"{") == "json"
    assert encoding_of("zenoh/bytes", "a", b'{"x": 1}') == "json"
    assert encoding_of("zenoh/bytes", "a", b"{binary") == "zenoh/bytes"
    assert encoding_of("zenoh/bytes", SCAN, b"\x00\x01") == "cdr"
