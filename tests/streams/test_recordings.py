"""Recordings of other tools become inputs, byte for byte, in their own time or in simulated time."""

from __future__ import annotations

import json

import pytest
from mcap.writer import Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

from contextpolicy.policy.parsing import parse as parse_policy
from contextpolicy.streams.recorded_message import RecordingError, Topic, ros_type
from contextpolicy.streams.recordings import (
    Excerpt,
    bridge_key,
    is_recording,
    keys_for,
    open_recording,
    rmw_key,
    timeline_key,
    timeline_of,
)
from contextpolicy.streams.timeline import RECORDED

STORE = get_typestore(Stores.LATEST)
BEGIN = 1_795_300_000 * 10**9


def clock(at):
    Clock, Time = STORE.types["rosgraph_msgs/msg/Clock"], STORE.types["builtin_interfaces/msg/Time"]  # noqa: N806
    return bytes(STORE.serialize_cdr(Clock(Time(int(at), round(at % 1 * 1e9))), "rosgraph_msgs/msg/Clock"))


def flag(value):
    return bytes(STORE.serialize_cdr(STORE.types["std_msgs/msg/Bool"](bool(value)), "std_msgs/msg/Bool"))


OPEN, SHUT = flag(1), flag(0)


@pytest.fixture
def mcap(tmp_path):
    """Ten JSON messages a second for one second, on a robot's topic; one more channel for viewers only."""
    path = tmp_path / "run.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        imu = writer.register_channel("robot/imu", "json", 0)
        other = writer.register_channel("robot/other", "cbor", 0)
        shown = writer.register_channel("robot/imu", "json", 0, {"derivedFrom": "robot/imu"})
        for index in range(10):
            at = BEGIN + index * 10**8
            writer.add_message(imu, at, json.dumps({"n": index}).encode(), at)
            writer.add_message(shown, at, b"{}", at)
        writer.add_message(other, BEGIN + 10**9, b"\xa0", BEGIN)
        writer.finish()
    return path


def bag(folder, plugin, messages):
    with BagWriter(folder, version=9, storage_plugin=plugin) as writer:
        connections = {}
        for at, topic, kind, payload in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(connections[topic], BEGIN + round(at * 1e9), payload)
    return folder


def ticks(recording):
    found = recording.messages(recording.topics, recording.begin, recording.end)
    return [((message.at - recording.begin) / 1e9, message.topic) for message in found]


def test_a_files_messages_come_as_they_were_recorded(mcap):
    recording = open_recording(mcap, Excerpt())
    assert recording.topics == {
        "robot/imu": Topic("robot/imu", "json", "", 10),
        "robot/other": Topic("robot/other", "cbor", "", 1),
    }
    payloads = [message.payload for message in recording.messages(["robot/imu"], recording.begin, recording.end)]
    assert payloads == [json.dumps({"n": index}).encode() for index in range(10)]


@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_a_bag_of_either_storage_is_read(tmp_path, plugin):
    messages = [(0, "/door", "std_msgs/msg/Bool", OPEN), (2.5, "/door", "std_msgs/msg/Bool", SHUT)]
    recording = open_recording(bag(tmp_path / "bag", plugin, messages), Excerpt())
    door = recording.topics.pop("/door")
    assert door[:4] == ("/door", "cdr", "std_msgs/msg/Bool", 2)
    assert door.definition == "bool data\n"
    assert door.hash in ("", STORE.hash_rihs01("std_msgs/msg/Bool"))  # rosbags writes none into MCAP files
    assert recording.topics == {}
    found = list(recording.messages(["/door"], recording.begin, recording.end))
    assert [(message.at - BEGIN, message.payload) for message in found] == [(0, OPEN), (25 * 10**8, SHUT)]


def test_simulated_time_is_the_clocks_latest_value(tmp_path):
    messages = [
        (0.0, "/door", "std_msgs/msg/Bool", OPEN),  # before the first tick: it has no time
        (0.5, "/clock", "rosgraph_msgs/msg/Clock", clock(100.0)),
        (0.7, "/door", "std_msgs/msg/Bool", SHUT),
        (1.5, "/clock", "rosgraph_msgs/msg/Clock", clock(100.25)),
        (1.6, "/door", "std_msgs/msg/Bool", OPEN),
    ]
    recording = open_recording(bag(tmp_path / "bag", StoragePlugin.MCAP, messages), Excerpt(use_sim_time=True))
    assert (recording.begin, recording.end) == (100 * 10**9, 100_250_000_000)
    assert [tick for tick in ticks(recording) if tick[1] == "/door"] == [(0.0, "/door"), (0.25, "/door")]


def test_without_a_clock_there_is_no_simulated_time(mcap):
    with pytest.raises(RecordingError, match="no messages on /clock"):
        open_recording(mcap, Excerpt(use_sim_time=True))


def test_a_folder_is_taken_for_a_bag_and_refused_as_one(tmp_path):
    assert is_recording(tmp_path)
    with pytest.raises(RecordingError, match=r"is a folder without metadata\.yaml, and no storage file"):
        open_recording(tmp_path, Excerpt())


def test_topics_get_the_keys_that_the_policys_streams_select():
    key = keys_for(a_policy("0/door/std_msgs::msg::dds_::Bool_/*", "0/light/std_msgs::msg::dds_::Bool_/RIHS01_ab"))
    door, light, other = (Topic(name, "cdr", "std_msgs/msg/Bool", 1) for name in ("/door", "/light", "/other"))
    assert key(door) == "0/door/std_msgs::msg::dds_::Bool_/TypeHashNotSupported"
    assert key(light) == "0/light/std_msgs::msg::dds_::Bool_/RIHS01_ab"
    assert key(other) == "other"
    assert keys_for(a_policy("door"))(door) == "door"


def a_policy(*keys):
    streams = [{"name": f"s{i}", "key": k, "encoding": "cdr", "type": "std_msgs/msg/Bool"} for i, k in enumerate(keys)]
    task = {"name": "slam", "selector": {"matchLabels": {"app": "slam"}}}
    return parse_policy({"metadata": {"name": "p", "namespace": "n"}, "spec": {"streams": streams, "tasks": [task]}})


def test_a_topics_key_contains_its_type_hash():
    topic = Topic("/imu/data", "cdr", "sensor_msgs/msg/Imu", 1, "RIHS01_ab")
    assert timeline_key(topic) == "0/imu/data/sensor_msgs::msg::dds_::Imu_/RIHS01_ab"
    assert timeline_key(topic._replace(hash="")).endswith("/TypeHashNotSupported")


def test_names_of_topics_and_types():
    topic = Topic("/imu/data", "cdr", "sensor_msgs/msg/Imu", 1)
    assert rmw_key(topic) == "0/imu/data/sensor_msgs::msg::dds_::Imu_/TypeHashNotSupported"
    assert bridge_key(topic) == "imu/data"
    assert [ros_type(name) for name in ("sensor_msgs/Imu", "sensor_msgs/msg/Imu", "foxglove.LaserScan", "")] == [
        "sensor_msgs/msg/Imu",
        "sensor_msgs/msg/Imu",
        "foxglove.LaserScan",
        "",
    ]


@pytest.mark.parametrize(
    ("excerpt", "numbers"),
    [
        (Excerpt(), range(10)),
        (Excerpt(start_offset=0.45), range(5, 10)),
        (Excerpt(start_offset=0.2, playback_duration=0.3), range(2, 6)),
        (Excerpt(topics=["robot/imu"]), range(10)),
        (Excerpt(topics=["robot/**"]), range(10)),
        (Excerpt(topics=["robot/other"]), ()),
    ],
)
def test_a_part_of_a_recording_becomes_a_timeline(mcap, excerpt, numbers):
    timeline = timeline_of(open_recording(mcap, excerpt), excerpt, bridge_key, name="run", wanted=["robot/imu"])
    taken = [json.loads(timed.payload)["n"] for timed in timeline.inputs() if timed.payload]
    assert taken == list(numbers)
    assert timeline.begin == pytest.approx(BEGIN / 1e9 + excerpt.start_offset)
    assert {timed.encoding for timed in timeline.inputs()} <= {RECORDED}


def test_unread_topics_are_named_but_not_loaded(mcap):
    timeline = timeline_of(open_recording(mcap, Excerpt()), Excerpt(), bridge_key, name="run", wanted=["robot/imu"])
    assert [timed.key for timed in timeline.inputs() if timed.payload is None] == ["robot/other"]


def test_messages_in_cdr_keep_their_type(tmp_path):
    path = bag(tmp_path / "bag", StoragePlugin.SQLITE3, [(0, "/door", "std_msgs/msg/Bool", OPEN)])
    timeline = timeline_of(open_recording(path, Excerpt()), Excerpt(), bridge_key, name="run", wanted=["door"])
    assert {(entry.key, entry.type) for entry in timeline.inputs()} == {("door", "std_msgs/msg/Bool")}


def test_an_offset_beyond_the_end_is_refused(mcap):
    excerpt = Excerpt(start_offset=5)
    with pytest.raises(RecordingError, match="invalid value 5: expected at most 1 s"):
        timeline_of(open_recording(mcap, excerpt), excerpt, bridge_key, name="run", wanted=[])
