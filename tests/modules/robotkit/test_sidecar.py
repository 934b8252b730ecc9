"""A node that knows nothing of robotkit, played by the test, and the sidecar that overhears it on a real bus."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from contextlib import contextmanager
from queue import Queue
from typing import Any

import pytest

from robotkit import ConfigurationError, Decision, ros
from robotkit.sidecar import STRANGE, Sidecar, load, main
from robotkit.stamps import ros_attachment
from tests.modules.robotkit.bus import Matching, ask, client, router
from tests.waiting import PATIENCE, until

SCAN, POSE = "sensor_msgs/msg/LaserScan", "geometry_msgs/msg/PoseWithCovarianceStamped"
SCAN_KEY, POSE_KEY = ros.topic_key("/scan", SCAN), ros.topic_key("/pose", POSE)
NODE = """
name: slam-toolbox
inputs:
  scan: {key: 0/scan/sensor_msgs::msg::dds_::LaserScan_/*, encoding: cdr, type: sensor_msgs/msg/LaserScan, depth: 5}
outputs:
  pose: {key: 0/pose/**, encoding: cdr, type: geometry_msgs/msg/PoseWithCovarianceStamped}
needs: {cores: 1, memory: 200Mi, deadline: 100ms}
"""
MS = 1_000_000
STAMP = 1_795_300_000_123_456_789


@pytest.fixture
def module(tmp_path):
    path = tmp_path / "module.yaml"
    path.write_text(NODE)
    return load(path, {})


class Robot:
    """A lidar and a node that answers its scans when the test says so."""

    def __init__(self, session):
        self.lidar, self.node = session.declare_publisher(SCAN_KEY), session.declare_publisher(POSE_KEY)
        self.health: Queue[dict[str, Any]] = Queue()
        self._listener = session.declare_subscriber(
            "robot/slam/health", lambda sample: self.health.put(json.loads(sample.payload.to_string()))
        )

    def scan(self, stamp):
        payload = ros.encode({"ranges": [1.0]}, SCAN, stamp=stamp, frame="laser")
        self.lidar.put(payload, attachment=ros_attachment(1, time.time_ns(), bytes(16)))

    def pose(self, stamp):
        self.node.put(ros.encode({}, POSE, stamp=stamp, frame="map"))

    def wait_for_health(self, wanted):
        """The first health message of which this holds."""
        while not wanted(message := self.health.get(timeout=PATIENCE)):
            pass
        return message


@contextmanager
def watched(module):
    with router() as address, client(address) as session, client(address) as own:
        robot = Robot(session)
        cpu = iter(range(0, 10**12, 3 * MS))
        with Sidecar(own, module, "slam", lambda: next(cpu), answers_all=True) as sidecar:
            Matching(robot.lidar).wait(expected=True)
            Matching(robot.node).wait(expected=True)
            yield robot, sidecar, session


def test_health_and_profile_are_those_of_the_node(module):
    with watched(module) as (robot, _, session):
        robot.scan(STAMP)
        robot.wait_for_health(lambda message: message["queue"] == 1)
        robot.pose(STAMP)
        health = robot.wait_for_health(lambda message: message["rate"] > 0)
        assert (health["queue"], health["waiting"], health["throttled"]) == (0, 0.0, None)
        assert health["misses"] == 1.0  # a health message is further away than the deadline
        assert health["cpu"] > 0
        (profile,) = map(json.loads, ask(session, "robot/slam/profile"))
        assert (profile["task"], profile["module"]) == ("slam", "slam-toolbox")
        assert profile["inputs"]["scan"]["done"] == 1


def test_a_scan_without_an_answer_waits_longer_and_longer(module):
    with watched(module) as (robot, _, _):
        robot.scan(STAMP)
        first = robot.wait_for_health(lambda message: message["queue"] == 1)
        later = robot.wait_for_health(lambda message: message["waiting"] > first["waiting"])
        assert later["misses"] == 1.0


def test_a_suspended_node_misses_nothing(module):
    with watched(module) as (robot, sidecar, _):
        robot.scan(STAMP)
        robot.wait_for_health(lambda message: message["queue"] == 1)
        sidecar.decide(Decision(0.01, 0.0, suspended=True))
        assert robot.wait_for_health(lambda message: message["suspended"])["queue"] == 0
        Matching(robot.lidar).wait(expected=False)
        sidecar.decide(Decision(1.0, 1.0))
        Matching(robot.lidar).wait(expected=True)
        robot.scan(STAMP)
        robot.wait_for_health(lambda message: message["queue"] == 1 and not message["suspended"])


def test_a_message_without_a_stamp_is_broken(module):
    with watched(module) as (robot, _, _):
        robot.lidar.put(b"\x00\x01")
        assert robot.wait_for_health(lambda message: message["broken"])["queue"] == 0


def test_answers_without_a_matching_input_are_reported(module, caplog):
    with watched(module) as (robot, _, _):
        for stamp in range(STRANGE):
            robot.pose(STAMP + stamp)
        until(lambda: "has the same header stamp as an input" in caplog.text)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            NODE.replace("encoding: cdr, type: sensor_msgs/msg/LaserScan, ", ""),
            "inputs.scan.encoding: invalid value 'json'",
        ),
        (NODE.partition("outputs:")[0] + "needs: {cores: 1}\n", "outputs: expected at least one"),
    ],
)
def test_unobservable_inputs_and_outputs_are_refused(tmp_path, text, said):
    path = tmp_path / "module.yaml"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=said):
        load(path, {})


def test_a_bad_configuration_is_one_line(tmp_path, capsys, monkeypatch):
    path = tmp_path / "module.yaml"
    path.write_text(NODE)
    monkeypatch.delenv("ZENOH_CONNECT", raising=False)
    assert main([str(path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_it_runs_as_a_program_and_ends_on_sigterm(tmp_path):
    path = tmp_path / "module.yaml"
    path.write_text(NODE)
    with router() as address, client(address) as session:
        robot = Robot(session)
        environment = {**os.environ, "ZENOH_CONNECT": address, "POLICY_TASK": "slam"}
        with subprocess.Popen([sys.executable, "-m", "robotkit.sidecar", str(path)], env=environment) as process:
            try:
                robot.wait_for_health(lambda message: message["queue"] == 0)
                process.terminate()
                assert process.wait(PATIENCE) == 0
            finally:
                process.kill()
