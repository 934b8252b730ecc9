from __future__ import annotations

import cv2
import numpy as np
import pytest

from robotkit import MessageError, Received
from robotkit.readings import COMPRESSED_IMAGE, IMAGE, IMU, imu, picture, sound
from robotkit.ros import decode, encode, stamp_of, topic_key
from robotkit.ros_types import AUDIO, AUDIO_STAMPED

STAMP = 1_700_000_000_123_456_789
POSE = "geometry_msgs/msg/PoseStamped"


def received(type_name, **fields):
    return Received(encode(fields, type_name, stamp=STAMP, frame="map"), 1, 2, "in", "cdr", type_name)


def test_a_result_becomes_a_message_with_its_header():
    pose = {"position": [1.0, 2.0, 3.0], "orientation": (0, 0, 0.6, 0.8)}
    message = decode(encode({"pose": pose}, POSE, stamp=STAMP, frame="map"), POSE)
    assert (message.header.frame_id, stamp_of(message)) == ("map", STAMP)
    assert (message.pose.position.z, message.pose.orientation.w) == (3.0, 0.8)


def test_a_topics_key_is_that_of_rmw_zenoh():
    imu_hash = "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b"  # as ROS 2 Jazzy prints it
    assert topic_key("/imu/data", IMU) == f"0/imu/data/sensor_msgs::msg::dds_::Imu_/{imu_hash}"


def test_omitted_fields_default_to_zero():
    odometry = decode(encode({}, "nav_msgs/msg/Odometry", stamp=STAMP), "nav_msgs/msg/Odometry")
    assert odometry.child_frame_id == ""
    assert odometry.pose.covariance.tolist() == [0.0] * 36


def test_numbers_texts_and_lists_of_messages():
    scan = decode(
        encode({"ranges": [1.5, float("inf")]}, "sensor_msgs/msg/LaserScan", stamp=1), "sensor_msgs/msg/LaserScan"
    )
    assert scan.ranges.tolist() == [1.5, float("inf")]
    joints = {"name": ["base", "grip"], "position": np.array([0.1, 0.2])}
    assert decode(encode(joints, "sensor_msgs/msg/JointState", stamp=1), "sensor_msgs/msg/JointState").name == [
        "base",
        "grip",
    ]
    path = {"poses": [{"pose": {"position": [1, 0, 0]}}]}
    assert decode(encode(path, "nav_msgs/msg/Path", stamp=1), "nav_msgs/msg/Path").poses[0].pose.position.x == 1
    assert decode(encode({"data": "stop"}, "std_msgs/msg/String", stamp=1), "std_msgs/msg/String").data == "stop"


@pytest.mark.parametrize("fields", [{"position": [1, 2, 3]}, {"pose": 7}, {"pose": {"position": [1, 2]}}])
def test_a_result_of_another_message_type_is_a_bug_of_the_module(fields):
    with pytest.raises((TypeError, ValueError)):
        encode(fields, POSE, stamp=STAMP)


@pytest.mark.parametrize(("payload", "type_name"), [(b"", IMU), (b"\x00\x01\x00\x00abc", IMU), (b"", "no/msg/Such")])
def test_a_broken_message_is_dropped(payload, type_name):
    with pytest.raises(MessageError):
        decode(payload, type_name)


def test_an_imu_sample_is_the_same_from_json_and_from_ros():
    from_ros = imu(received(IMU, angular_velocity=[1, 2, 3], linear_acceleration=[4, 5, 6]))
    text = b'{"stamp": 1700000000123456789, "gyro": [1, 2, 3], "accel": [4, 5, 6]}'
    assert imu(Received(text, 1, 2)) == from_ros
    assert (from_ros.stamp, from_ros.gyro, from_ros.accel) == (STAMP, (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))


@pytest.mark.parametrize("payload", [b"", b"[]", b"{}", b'{"gyro": [1, 2], "accel": [1, 2, 3]}', b'{"gyro": "xyz"}'])
def test_invalid_imu_samples_are_refused(payload):
    with pytest.raises(MessageError, match="not an IMU sample"):
        imu(Received(payload, 1, 2))


@pytest.mark.parametrize("type_name", [AUDIO, AUDIO_STAMPED])
def test_sound_from_ros(type_name):
    fields = {"data": b"\x01\x02"} if type_name == AUDIO else {"audio": {"data": b"\x01\x02"}}
    assert sound(received(type_name, **fields)) == b"\x01\x02"


@pytest.mark.parametrize("sample", [Received(b"abc", 1, 2), Received(b"", 1, 2, "in", "cdr", IMU)])
def test_invalid_sound_is_refused(sample):
    with pytest.raises(MessageError):
        sound(sample)


GRAY = np.array([[0, 50, 100], [150, 200, 250]], np.uint8)
RED = np.zeros((2, 3, 3), np.uint8) + np.array([0, 0, 255], np.uint8)


def image(pixels, encoding, *, padding=0):
    rows = pixels.reshape(pixels.shape[0], -1)
    padded = np.pad(rows, ((0, 0), (0, padding)))
    return received(
        IMAGE,
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        step=padded.shape[1],
        data=padded.tobytes(),
    )


@pytest.mark.parametrize("padding", [0, 5])
def test_a_gray_picture_from_ros(padding):
    pixels, stamp = picture(image(GRAY, "mono8", padding=padding), gray=True)
    assert stamp == STAMP
    assert pixels.tolist() == GRAY.tolist()


@pytest.mark.parametrize("encoding", ["bgr8", "rgb8", "bgra8", "rgba8"])
def test_a_coloured_picture_from_ros_is_bgr(encoding):
    sent = RED if encoding.startswith("bgr") else RED[:, :, ::-1]
    sent = np.dstack([sent, np.full((2, 3), 255, np.uint8)]) if encoding.endswith("a8") else sent
    pixels, _ = picture(image(sent, encoding))
    assert pixels.tolist() == RED.tolist()
    assert picture(image(sent, encoding), gray=True)[0][0, 0] == 76  # red is 30 % of the brightness


def test_a_compressed_picture_from_ros_and_as_it_is():
    encoded = cv2.imencode(".png", GRAY)[1].tobytes()
    assert picture(received(COMPRESSED_IMAGE, format="png", data=encoded), gray=True)[0].tolist() == GRAY.tolist()
    assert picture(Received(encoded, 5, 6), gray=True)[1] == 5


@pytest.mark.parametrize(
    "sample",
    [
        Received(b"", 1, 2),
        Received(b"noise", 1, 2),
        received(COMPRESSED_IMAGE, data=b"noise"),
        received(IMAGE, height=2, width=3, encoding="mono8", step=3, data=b"short"),
        received(IMAGE, height=2, width=3, encoding="bayer_rggb8", step=3, data=b"123456"),
        received(IMU),
    ],
)
def test_invalid_pictures_are_refused(sample):
    with pytest.raises(MessageError):
        picture(sample)
