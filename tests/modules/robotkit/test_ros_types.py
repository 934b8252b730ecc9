"""Older releases of ROS, and message types of the robot's own."""

from __future__ import annotations

import pytest
from rosbags.typesys import Stores, get_typestore

from robotkit import ConfigurationError, Input, MessageError, Module, Received
from robotkit.readings import imu
from robotkit.ros import decode, encode, topic_key
from robotkit.ros_check import check
from robotkit.ros_types import hash_of, type_store

HUMBLE = get_typestore(Stores.ROS2_HUMBLE)
RANGE = "sensor_msgs/msg/Range"
MOOD = "my_robot/msg/Mood"


def a_range():
    """Humble's Range has no variance."""
    time = HUMBLE.types["builtin_interfaces/msg/Time"](1, 2)
    header = HUMBLE.types["std_msgs/msg/Header"](time, "sonar")
    return bytes(HUMBLE.serialize_cdr(HUMBLE.types[RANGE](header, 0, 0.5, 0.02, 4.0, 1.25), RANGE))


def test_a_message_is_read_with_its_own_release():
    with pytest.raises(MessageError, match="of ROS 2 latest"):
        decode(a_range(), RANGE)
    assert decode(a_range(), RANGE, release="humble").range == 1.25


def test_readings_use_the_release_of_their_input():
    payload = encode({"linear_acceleration": [1, 2, 3]}, "sensor_msgs/msg/Imu", stamp=5, release="humble")
    received = Received(payload, 1, 2, "raw", "cdr", "sensor_msgs/msg/Imu", ros="humble")
    assert imu(received).accel == (1.0, 2.0, 3.0)


def test_types_without_a_hash_use_rmw_zenohs_placeholder():
    assert topic_key("/sonar", RANGE, release="humble") == "0/sonar/sensor_msgs::msg::dds_::Range_/TypeHashNotSupported"
    assert hash_of(RANGE) == get_typestore(Stores.LATEST).hash_rihs01(RANGE)


def test_messages_that_lyrical_no_longer_has_are_read():
    kilted = get_typestore(Stores.ROS2_KILTED).fielddefs.keys()
    gone = kilted - get_typestore(Stores.ROS2_LYRICAL).fielddefs.keys()
    assert gone <= type_store().fielddefs.keys()


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "my_robot/msg").mkdir(parents=True)
    (tmp_path / "my_robot/msg/Mood.msg").write_text("std_msgs/Header header\nfloat32 joy\nstring word\n")
    return tmp_path


def test_own_types_are_read_and_written(folder):
    payload = encode({"joy": 0.5, "word": "fine"}, MOOD, stamp=5, frame="heart", folder=str(folder))
    message = decode(payload, MOOD, folder=str(folder))
    assert (message.joy, message.word, message.header.frame_id) == (0.5, "fine", "heart")
    check(Module("m", inputs={"mood": Input("mood", "cdr", MOOD, types=str(folder))}))
    with pytest.raises(MessageError, match="unknown message type my_robot/msg/Mood: ROS 2 latest"):
        decode(payload, MOOD)


@pytest.mark.parametrize("text", ["float32", "{}", "no_such/Type x"])
def test_a_definition_with_mistakes_is_refused_at_the_start(folder, text):
    (folder / "my_robot/msg/Mood.msg").write_text(text)
    module = Module("m", inputs={"mood": Input("mood", "cdr", MOOD, types=str(folder))})
    with pytest.raises(ConfigurationError, match=r"Mood|inputs\.mood"):
        check(module)


def test_a_folder_without_definitions_is_refused_at_the_start(tmp_path):
    with pytest.raises(ConfigurationError, match=r"a folder with \.msg or \.idl files"):
        check(Module("m", inputs={"mood": Input("mood", "cdr", MOOD, types=str(tmp_path))}))
