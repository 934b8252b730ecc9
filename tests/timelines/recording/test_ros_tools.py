"""What we record of ROS topics opens in the libraries that ROS users read recordings with, as file and as folder."""

from __future__ import annotations

import threading
from io import BytesIO

import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import Reader, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from contextpolicy.streams.recorded_message import NO_DAMAGE, RecordingError, Topic
from contextpolicy.streams.recordings import Excerpt, bridge_key, open_recording, timeline_key
from contextpolicy.streams.timeline import parse
from robotkit import Module, Output
from robotkit.ros_presence import RosPresence
from tests.modules.robotkit.bus import Matching, client, router
from tests.waiting import until
from timelines.recording.bag_folder import BagWriter
from timelines.recording.mcap_file import McapWriter
from timelines.recording.recorder import BusRecorder
from timelines.recording.ros_offers import TOKENS, offer_of
from timelines.recording.ros_topics import RosTopics, completed
from timelines.replay.player import Options, TimelineInputs, publish
from timelines.replay.recorded import RecordedInputs

STORE, HUMBLE = get_typestore(Stores.LATEST), get_typestore(Stores.ROS2_HUMBLE)
AT = 1_795_300_000 * 10**9
SCAN, POSE, RANGE = "sensor_msgs/msg/LaserScan", "geometry_msgs/msg/PoseStamped", "sensor_msgs/msg/Range"
MOOD = "my_robot/msg/Mood"
SENSOR_DATA = Qos(
    QosHistory.KEEP_LAST,
    5,
    QosReliability.BEST_EFFORT,
    QosDurability.VOLATILE,
    QosTime(9223372036, 854775807),
    QosTime(9223372036, 854775807),
    QosLiveliness.AUTOMATIC,
    QosTime(9223372036, 854775807),
    avoid_ros_namespace_conventions=False,
)


def key(topic, kind, type_hash="TypeHashNotSupported"):
    package, _, name = kind.partition("/msg/")
    return f"0/{topic}/{package}::msg::dds_::{name}_/{type_hash}"


def header(store=STORE):
    return store.types["std_msgs/msg/Header"](store.types["builtin_interfaces/msg/Time"](12, 34), "base_link")


def a_pose(x):
    types = {name: STORE.types[f"geometry_msgs/msg/{name}"] for name in ("Pose", "Point", "Quaternion")}
    pose = types["Pose"](types["Point"](x, 0.0, 0.0), types["Quaternion"](0.0, 0.0, 0.0, 1.0))
    return bytes(STORE.serialize_cdr(STORE.types[POSE](header(), pose), POSE))


def heard(writer, name, payload, at=AT):
    writer.heard(name, "cdr", payload, received=at, stamp=at - 1000)


def decoded(path):
    """What mcap-ros2-support makes of a file: times, topics and messages."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [
            (one.message.log_time, one.channel.topic, one.decoded_message) for one in reader.iter_decoded_messages()
        ]


def connections(path):
    """What rosbags makes of it."""
    with Reader(path) as reader:
        found = {one.topic: one for one in reader.connections}
        taken = [(at, connection.topic, bytes(data)) for connection, at, data in reader.messages(reader.connections)]
    return found, taken


def test_a_file_of_ros_topics_opens_in_both_libraries(tmp_path):
    path = tmp_path / "run.mcap"
    with McapWriter(path) as writer:
        heard(writer, key("slam/pose", POSE), a_pose(1.5))
        heard(writer, key("slam/pose", POSE), a_pose(2.5), AT + 10**9)
    assert [(at, topic, message.pose.position.x) for at, topic, message in decoded(path)] == [
        (AT, "/slam/pose", 1.5),
        (AT + 10**9, "/slam/pose", 2.5),
    ]
    found, taken = connections(path)
    assert found["/slam/pose"].msgtype == POSE
    assert [data for _, _, data in taken] == [a_pose(1.5), a_pose(2.5)]
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        ((schema, channel, _), *_) = reader.iter_messages()
    assert schema is not None
    assert (schema.name, schema.encoding, channel.message_encoding) == (POSE, "ros2msg", "cdr")
    assert channel.metadata == {"offered_qos_profiles": "[]", "topic_type_hash": STORE.hash_rihs01(POSE)}


def test_a_folder_with_other_topics_opens_in_both_libraries(tmp_path):
    folder = tmp_path / "run"
    with BagWriter(folder, RosTopics()) as writer:
        heard(writer, key("slam/pose", POSE), a_pose(1.5))
        writer.heard("robot/imu", "json", b"{}", received=AT, stamp=AT)
        writer.counted("cgroup/slam", "cgroup", {"limit": 1.0}, AT)
        heard(writer, key("slam/pose", POSE), a_pose(2.5), AT + 10**9)
    with AnyReader([folder]) as any_reader:
        assert any_reader.message_count == 2
        assert (any_reader.start_time, any_reader.duration) == (AT, 10**9 + 1)
        poses = [any_reader.deserialize(data, one.msgtype) for one, _, data in any_reader.messages()]
    assert [pose.pose.position.x for pose in poses] == [1.5, 2.5]  # type: ignore[attr-defined]
    assert len(decoded(folder / "run_0.mcap")) == 2
    others = open_recording(folder / "bus.mcap", Excerpt())
    assert others.topics.keys() == {"robot/imu", "cgroup/slam"}
    assert open_recording(folder, Excerpt()).topics.keys() == {"/slam/pose"}


@pytest.mark.parametrize("name", ["robot/microphone", "camera/side", "robot/lidar/scan"])
def test_ros_topics_named_like_ours_are_only_recorded(tmp_path, name):
    """On the keys of zenoh-bridge-ros2dds nothing but the recording says that they are of ROS."""
    folder, topics = tmp_path / "run", RosTopics({name: completed(Topic(f"/{name}", "cdr", POSE, 0))})
    with BagWriter(folder, topics) as writer:
        writer.heard(name, "zenoh/bytes", a_pose(1.5), received=AT, stamp=AT)
    found, taken = connections(folder)
    assert (found.keys(), len(taken)) == ({f"/{name}"}, 1)
    with (folder / "run_0.mcap").open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        assert {channel.message_encoding for _, channel, _ in reader.iter_messages()} == {"cdr"}


def test_a_folders_file_is_of_ros_before_it_is_complete(tmp_path):
    """A power cut leaves it so, and rosbags reads no file of another profile, not even a repaired one."""
    with BagWriter(tmp_path / "run", RosTopics()) as writer:
        writer._ros._file.flush()
        begun = (tmp_path / "run" / "run_0.mcap").read_bytes()
    assert make_reader(BytesIO(begun)).get_header().profile == "ros2"


def test_a_folders_metadata_is_what_rosbag2_expects(tmp_path):
    with BagWriter(tmp_path / "run", RosTopics()) as writer:
        heard(writer, key("slam/pose", POSE), a_pose(1.5))
    about = yaml.safe_load((tmp_path / "run" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert about["relative_file_paths"] == ["run_0.mcap"]
    assert about["topics_with_message_count"] == [
        {
            "topic_metadata": {
                "name": "/slam/pose",
                "type": POSE,
                "serialization_format": "cdr",
                "offered_qos_profiles": [],
                "type_description_hash": STORE.hash_rihs01(POSE),
            },
            "message_count": 1,
        }
    ]
    with RosbagsWriter(tmp_path / "theirs", version=9, storage_plugin=StoragePlugin.MCAP) as theirs:
        theirs.write(theirs.add_connection("/slam/pose", POSE, typestore=STORE), AT, a_pose(1.5))
    expected = yaml.safe_load((tmp_path / "theirs" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert about.keys() == expected.keys()
    assert about["topics_with_message_count"] == expected["topics_with_message_count"]


def test_a_folder_that_exists_is_not_written_into(tmp_path):
    with pytest.raises(RecordingError, match="already exists"):
        BagWriter(tmp_path, RosTopics())


def test_an_older_releases_message_has_its_own_definition(tmp_path):
    """Range has a field more since Jazzy."""
    assert STORE.hash_rihs01(RANGE) != HUMBLE.hash_rihs01(RANGE)
    message = HUMBLE.types[RANGE](header(HUMBLE), 0, 0.1, 0.02, 4.0, 1.25)
    payload = bytes(HUMBLE.serialize_cdr(message, RANGE))
    with McapWriter(tmp_path / "run.mcap") as writer:
        heard(writer, key("sonar", RANGE, HUMBLE.hash_rihs01(RANGE)), payload)
    ((_, _, reported),) = decoded(tmp_path / "run.mcap")
    assert reported.range == 1.25


def test_an_unknown_type_keeps_its_name_and_hash(tmp_path):
    with McapWriter(tmp_path / "run.mcap") as writer:
        heard(writer, key("mood", MOOD, "RIHS01_ab"), b"\x00\x01\x00\x00")
        heard(writer, key("scan", SCAN, "RIHS01_of_a_fork"), b"\x00\x01\x00\x00")
    found, _ = connections(tmp_path / "run.mcap")
    assert {topic: one.msgtype for topic, one in found.items()} == {"/mood": MOOD, "/scan": SCAN}
    assert [one.msgdef.data for one in found.values()] == ["", ""]  # a wrong definition would be worse than none
    assert open_recording(tmp_path / "run.mcap", Excerpt()).topics["/mood"].hash == "RIHS01_ab"


def test_own_types_and_qos_go_from_one_recording_into_the_next(tmp_path):
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg("float32 joy\nstring word", MOOD))
    payload = bytes(store.serialize_cdr(store.types[MOOD](0.5, "fine"), MOOD))
    with RosbagsWriter(tmp_path / "own", version=9, storage_plugin=StoragePlugin.MCAP) as theirs:
        connection = theirs.add_connection("/mood", MOOD, typestore=store, offered_qos_profiles=[SENSOR_DATA])
        theirs.write(connection, AT, payload)
    inputs = RecordedInputs(tmp_path / "own", Excerpt(), bridge_key, NO_DAMAGE)
    with McapWriter(tmp_path / "run.mcap", RosTopics(inputs.topics)) as writer:
        for at, name, data in inputs.timed(0):
            heard(writer, name, data, AT + round(at * 1e9))
    ((_, topic, message),) = decoded(tmp_path / "run.mcap")
    assert (topic, message.joy, message.word) == ("/mood", 0.5, "fine")
    found, _ = connections(tmp_path / "run.mcap")
    assert found["/mood"].ext.offered_qos_profiles == [SENSOR_DATA]


TIMELINE = {
    "name": "ros",
    "duration": 1.0,
    "inputs": [
        {
            "key": key("scan", SCAN),
            "encoding": "cdr",
            "type": SCAN,
            "from": 0,
            "to": 1,
            "rate": 20,
            "value": {"ranges": [1.5], "header": {"frame_id": "laser"}},
        },
    ],
}


@pytest.mark.parametrize("name", ["run.mcap", "run"])
def test_a_replay_is_recorded_for_ros(tmp_path, name):
    inputs, path = TimelineInputs(parse(TIMELINE)), tmp_path / name
    topics = RosTopics(inputs.topics)
    with router() as address, client(address) as player, client(address) as listener:
        file = McapWriter(path, topics) if path.suffix else BagWriter(path, topics)
        with file, BusRecorder(listener, file):
            with player.declare_publisher(key("scan", SCAN)) as publisher:
                Matching(publisher).wait(expected=True)
            publish(inputs, player, stop=threading.Event(), options=Options(rate=2))
    scans = decoded(path if path.suffix else path / "run_0.mcap")
    assert len(scans) >= 15  # a busy machine's bus may drop some
    assert {(topic, tuple(message.ranges), message.header.frame_id) for _, topic, message in scans} == {
        ("/scan", (1.5,), "laser")
    }
    again = RecordedInputs(path, Excerpt(), timeline_key, NO_DAMAGE)
    assert again.encodings == {key("scan", SCAN, STORE.hash_rihs01(SCAN)): "cdr"}


def test_the_qos_of_publishers_on_the_bus_is_recorded(tmp_path):
    module = Module("scanner", outputs={"scan": Output(key("scan", SCAN, STORE.hash_rihs01(SCAN)), "cdr", SCAN)})
    topics = RosTopics()
    with router() as address, client(address) as robot, client(address) as listener:
        presence = RosPresence(robot, "scanner", module)
        until(lambda: list(listener.liveliness().get(TOKENS, timeout=2)))
        with McapWriter(tmp_path / "run.mcap", topics) as file:
            with BusRecorder(listener, file, topics=topics):
                pass
            heard(file, key("scan", SCAN), b"\x00\x01\x00\x00")
        presence.close()
    found, _ = connections(tmp_path / "run.mcap")
    (offered,) = found["/scan"].ext.offered_qos_profiles
    assert (offered.depth, offered.reliability, offered.durability) == (
        10,
        QosReliability.RELIABLE,
        QosDurability.VOLATILE,
    )


@pytest.mark.parametrize(
    ("qos", "expected"),
    [
        ("::,:,:,:,,", ("reliable", "volatile", "keep_last", 42)),
        ("2:1:2,7:1,2:3,4:3,5,6", ("best_effort", "transient_local", "keep_all", 7)),
    ],
)
def test_a_tokens_qos(qos, expected):
    token = f"@ros2_lv/0/c0ffee/0/1/MP/%/%/talker/%robot%chatter/std_msgs::msg::dds_::String_/RIHS01_ab/{qos}"
    found = offer_of(token)
    assert found is not None
    name, profile = found
    assert name == "/robot/chatter"
    assert tuple(profile[field] for field in ("reliability", "durability", "history", "depth")) == expected


@pytest.mark.parametrize("end", ["", "::", "::,x:,:,:,,", "::,1:,:,:", "::,1:1:,:,,"])
def test_an_invalid_token_offers_nothing(end):
    assert offer_of(f"@ros2_lv/0/c0ffee/0/1/MP/%/%/talker/%c/std_msgs::msg::dds_::String_/RIHS01_ab/{end}") is None
    assert offer_of("@ros2_lv/0/c0ffee/0/0/NN/%/%/talker") is None
