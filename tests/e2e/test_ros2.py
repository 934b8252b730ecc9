"""A ROS 2 robot: messages of its own, latched topics and a lidar, from a timeline as rmw_zenoh would publish them."""

from __future__ import annotations

import json

import pytest
import zenoh
import zenoh.ext

from contextpolicy.app.kopf_handlers import REREAD
from contextpolicy.streams.timeline import parse
from tests.e2e.background import Background
from tests.e2e.cluster import apply, delete, until
from tests.e2e.conftest import router
from timelines.replay.player import play

DEFINITIONS = {"my_msgs.msg.Mood.msg": "std_msgs/Header header\nfloat64 joy\n"}
MOVING = {"tasks": {"speech": {"suspend": True}}}


class Playing(Background):
    """A timeline, beside what is looked at."""

    def __init__(self, story, session):
        super().__init__(lambda: play(story, session, stop=self._stop), patience=5.0)


def stream(robot, name, message_type, **more):
    return {"name": name, "key": f"{robot.namespace}/{name}/*", "encoding": "cdr", "type": message_type, **more}


def an_input(robot, name, message_type, value):
    entry = {"key": f"{robot.namespace}/{name}/hash", "encoding": "cdr", "type": message_type, "value": value}
    return {**entry, "from": 0, "to": 4, "rate": 20}


@pytest.fixture
def config_map(robot):
    metadata = {"name": "robot-types", "namespace": robot.namespace}
    yield {"apiVersion": "v1", "kind": "ConfigMap", "metadata": metadata, "data": DEFINITIONS}
    delete("configmap", "robot-types", robot.namespace)


def test_timeline_drives_a_policy_with_custom_messages(governed, session, config_map):
    """The ConfigMap comes after the policy, as GitOps may bring it."""
    mood = stream(governed, "mood", "my_msgs/msg/Mood", types="robot-types", timestamp="header.stamp", staleAfter="1s")
    scan = stream(governed, "scan", "sensor_msgs/msg/LaserScan", timestamp="header.stamp", staleAfter="1s")
    near = "mood.joy > 1.0 && scan.ranges.exists(r, r < 1.0)"
    governed.policy(streams=[mood, scan], contexts=[{"name": "moving", "when": near, **MOVING}])
    until("the policy waits", lambda: "robot-types" in governed.condition("Accepted")[1] or governed.status())
    apply(config_map)
    accepted = lambda: governed.condition("Accepted")[0] == "True" or governed.status()  # noqa: E731
    until("the policy is accepted", accepted, patience=REREAD + 20)
    inputs = [
        an_input(governed, "mood", "my_msgs/msg/Mood", {"joy": "Infinity"}),
        an_input(governed, "scan", "sensor_msgs/msg/LaserScan", {"ranges": ["NaN", "Infinity", 0.5]}),
    ]
    story = parse({"name": "glad", "duration": 4, "inputs": inputs}, tuple(DEFINITIONS.items()))
    with Playing(story, session):
        governed.expect(slam=990, speech=10)
    governed.expect(slam=500, speech=500)


def test_a_latched_topic_reaches_a_policy_that_comes_later(governed):
    config = zenoh.Config()
    settings = {"mode": "client", "connect/endpoints": [router()], "timestamping/enabled": True}
    for name, value in {**settings, "scouting/multicast/enabled": False}.items():
        config.insert_json5(name, json.dumps(value))
    with zenoh.open(config) as driver:
        cache = zenoh.ext.CacheConfig(max_samples=1)
        key = f"{governed.namespace}/mission/hash"
        publisher = zenoh.ext.declare_advanced_publisher(driver, key, cache=cache, publisher_detection=True)
        publisher.put(b"\0\1\0\0\1")
        mission = stream(governed, "mission", "std_msgs/msg/Bool")
        governed.policy(streams=[mission], contexts=[{"name": "moving", "when": "mission.data", **MOVING}])
        governed.expect(slam=990, speech=10)
        publisher.undeclare()


def test_simulated_time_is_reported_and_moves_cpu(governed, session):
    """`header.stamp` counts from the start of the simulation, 1970 for the operator."""
    odom = stream(governed, "odom", "nav_msgs/msg/Odometry", timestamp="header.stamp", staleAfter="1s")
    fast = "odom.twist.twist.linear.x > 0.1"
    governed.policy(streams=[odom], contexts=[{"name": "moving", "when": fast, **MOVING}])
    header = {"stamp": {"sec": 17}}
    value = {"header": header, "twist": {"twist": {"linear": {"x": 0.5}}}}
    driving = {**an_input(governed, "odom", "nav_msgs/msg/Odometry", value), "to": 8}
    story = parse({"name": "sim", "duration": 8, "inputs": [driving]})
    with Playing(story, session):
        governed.expect(slam=990, speech=10)
        until(
            "the status reports the other clock",
            lambda: "another clock" in governed.status()["streams"][0].get("message", "") or governed.status(),
        )
