"""Our liveliness tokens are, byte for byte, those of rmw_zenoh; `ros2 topic list` is made of nothing else."""

from __future__ import annotations

import pytest

from robotkit import Input, Module, Output
from robotkit.ros import topic_key
from robotkit.ros_graph import PUBLISHER, SUBSCRIPTION, GraphNode, GraphTopic, node_name, topic_of
from robotkit.ros_presence import RosPresence
from robotkit.ros_types import hash_of
from tests.modules.robotkit.bus import client, router
from tests.waiting import until

POSE, SCAN = "geometry_msgs/msg/PoseStamped", "sensor_msgs/msg/LaserScan"
STRING = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"

# What follows is built by another reading of rmw_zenoh's liveliness_utils.cpp, which shares nothing with robotkit: the
# parts in the order of `enum KeyexprIndex`, `mangle_name`, and `qos_to_keyexpr` with the numbers of rmw/types.h.

RELIABLE, VOLATILE, KEEP_LAST, AUTOMATIC, INFINITE = 1, 2, 1, 1, (9223372036, 854775807)
DEFAULTS = (RELIABLE, VOLATILE, KEEP_LAST, 42, *INFINITE, *INFINITE, AUTOMATIC, *INFINITE)


def qos_to_keyexpr(*profile):
    """Reliability:durability:history,depth:deadline s,ns:lifespan s,ns:liveliness,lease s,ns."""
    text = ["" if value == default else str(value) for value, default in zip(profile, DEFAULTS, strict=True)]
    return "{}:{}:{},{}:{},{}:{},{}:{},{},{}".format(*text)


def liveliness_keyexpr(parts):
    """The loop in Entity::Entity: parts up to the first empty one, with delimiters between them."""
    keyexpr = ""
    for index, part in enumerate(parts):
        keyexpr += part
        if index == len(parts) - 1 or not parts[index + 1]:
            break
        keyexpr += "/"
    return keyexpr


def token(zid, number, kind, name, topic=("", "", "", "")):
    parts = ["@ros2_lv", "0", zid, "0", str(number), kind, "/", "/", name, *topic]
    mangled = ["".join("%" if sign == "/" else sign for sign in part) for part in parts]
    return liveliness_keyexpr(mangled)


def depth(count):
    return qos_to_keyexpr(RELIABLE, VOLATILE, KEEP_LAST, count, *DEFAULTS[4:])


def test_the_examples_of_rmw_zenohs_design_document():
    node = GraphNode("aac3178e146ba6f1fc6e6a4085e77f21", "listener")
    assert node.token() == "@ros2_lv/0/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener"
    chatter = GraphTopic(0, "/chatter", "std_msgs::msg::dds_::String_", STRING)
    assert node.endpoint(10, SUBSCRIPTION, chatter) == (
        "@ros2_lv/0/aac3178e146ba6f1fc6e6a4085e77f21/0/10/MS/%/%/listener/"
        f"%chatter/std_msgs::msg::dds_::String_/{STRING}/::,10:,:,:,,"
    )
    talker = GraphNode("8b20917502ee955ac4476e0266340d5c", "talker")
    seven = GraphTopic(0, "/chatter", "std_msgs::msg::dds_::String_", STRING, depth=7)
    assert talker.endpoint(10, PUBLISHER, seven) == (
        "@ros2_lv/0/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/"
        f"%chatter/std_msgs::msg::dds_::String_/{STRING}/::,7:,:,:,,"
    )


@pytest.mark.parametrize("count", [1, 7, 10, 42, 1000])
@pytest.mark.parametrize("kind", [PUBLISHER, SUBSCRIPTION])
def test_tokens_match_an_independent_implementation(kind, count):
    node = GraphNode("c0ffee", "slam")
    described = ("/robot1/slam/pose", "geometry_msgs::msg::dds_::PoseStamped_", hash_of(POSE))
    assert node.token() == token("c0ffee", 0, "NN", "slam")
    assert node.endpoint(3, kind, GraphTopic(0, *described, count)) == token(
        "c0ffee", 3, kind, "slam", (*described, depth(count))
    )


def test_a_key_gives_topic_type_and_hash():
    assert topic_of(topic_key("/slam/pose", POSE), type_hash="RIHS01_other") == GraphTopic(
        0, "/slam/pose", "geometry_msgs::msg::dds_::PoseStamped_", hash_of(POSE)
    )
    wild = topic_of("7/scan/sensor_msgs::msg::dds_::LaserScan_/*", type_hash="RIHS01_known")
    assert wild == GraphTopic(7, "/scan", "sensor_msgs::msg::dds_::LaserScan_", "RIHS01_known")


@pytest.mark.parametrize(
    "key", ["robot/imu", "imu/data", "*/scan/sensor_msgs::msg::dds_::LaserScan_/x", "0/*/a::msg::dds_::B_/x"]
)
def test_other_keys_are_not_ros_topics(key):
    assert topic_of(key, type_hash="x") is None


@pytest.mark.parametrize(
    ("task", "name"),
    [("front-camera.2", "front_camera_2"), ("3d-slam", "task_3d_slam"), ("größe", "gr__e"), ("slam", "slam")],
)
def test_node_names_are_made_valid_for_ros(task, name):
    assert node_name(task) == name


MODULE = Module(
    "front-slam",
    inputs={
        "scan": Input("0/scan/sensor_msgs::msg::dds_::LaserScan_/*", "cdr", SCAN, depth=5),
        "own": Input("robot/imu"),
    },
    outputs={"pose": Output(topic_key("/slam/pose", POSE), "cdr", POSE), "own": Output("robot/slam/pose")},
)


def test_the_bus_sees_the_node_and_its_topics_until_they_are_gone():
    with router() as address, client(address) as session, client(address) as ros:
        zid = str(session.info.zid())
        node = token(zid, 0, "NN", "front_slam")
        pose = ("/slam/pose", "geometry_msgs::msg::dds_::PoseStamped_", hash_of(POSE), depth(10))
        scan = ("/scan", "sensor_msgs::msg::dds_::LaserScan_", hash_of(SCAN), depth(5))
        published = token(zid, 1, "MP", "front_slam", pose)
        subscribed = token(zid, 2, "MS", "front_slam", scan)

        def seen():
            replies = ros.liveliness().get("@ros2_lv/0/**", timeout=2)
            return {str(reply.ok.key_expr) for reply in replies if reply.ok}

        presence = RosPresence(session, "front-slam", MODULE)
        until(lambda: seen() == {node, published})
        presence.resume()
        presence.resume()
        until(lambda: seen() == {node, published, subscribed})
        presence.pause()
        until(lambda: seen() == {node, published})
        presence.close()
        until(lambda: seen() == set())
