"""The modules with hardware as pods, each with the simulator of its device beside it."""

from __future__ import annotations

import json

import pytest
import yaml

from tests.e2e.cluster import REPOSITORY, apply, run, until
from tests.e2e.conftest import router

PATIENCE_S = 90
"""A guard with 50m needs seconds to start Python."""


class Heard:
    """The newest message of each key."""

    def __init__(self, session):
        self._newest = {}
        self._session = session
        self._subscriber = session.declare_subscriber("robot/**", self._hear)

    def _hear(self, sample):
        if str(sample.key_expr).rpartition("/")[2] in {"scan", "odometry", "state"}:
            self._newest[str(sample.key_expr)] = json.loads(sample.payload.to_bytes())

    def until(self, what, key, holds):
        def heard():
            message = self._newest.get(key)
            return True if message is not None and holds(message) else message

        until(what, heard, PATIENCE_S)

    def order(self, module, order):
        self._session.put(f"robot/{module}/order", json.dumps(order))


MODULES = ("navigation", "lidar", "arm")


def pods(namespace):
    """The pods of the modules' deployments, so that they can be named."""
    settings = ("--set", "image.tag=dev", "--set", f"zenoh.connect={router()},zenoh.secret=")
    rendered = run("helm", "template", "robot", str(REPOSITORY / "charts" / "robot"), *settings)
    for deployment in yaml.safe_load_all(rendered):
        name = deployment["metadata"]["name"]
        if name in MODULES:
            template = deployment["spec"]["template"]
            metadata = {"name": name, "namespace": namespace, **template["metadata"]}
            yield {"apiVersion": "v1", "kind": "Pod", "metadata": metadata, "spec": template["spec"]}


@pytest.fixture
def heard(empty, session):
    apply(*pods(empty.namespace))
    heard = Heard(session)
    heard.until("the lidar scans", "robot/lidar/scan", lambda scan: scan["nearest"] > 1)
    heard.until(
        "the robot publishes where it is", "robot/navigation/odometry", lambda reported: reported["travelled"] == 0
    )
    return heard


def test_the_robot_drives_until_ordered_to_stop_and_the_arm_moves(heard):
    heard.order("navigation", {"waypoints": [[50, 0]]})
    heard.until("it drives", "robot/navigation/odometry", lambda reported: reported["travelled"] > 0.2)
    heard.order("navigation", {"stop": True})
    heard.until("it stands", "robot/navigation/state", lambda reported: reported["doing"] == "stopped")
    heard.order("arm", {"move": [120, 60, 40]})
    heard.until("the arm has moved", "robot/arm/state", lambda reported: reported["doing"] == "arrived")


def test_a_controller_that_was_killed_leaves_a_robot_that_stands(heard, empty):
    heard.order("navigation", {"waypoints": [[50, 0]]})
    heard.until("it drives", "robot/navigation/odometry", lambda reported: reported["travelled"] > 0.2)
    empty.kill("navigation")
    until("the kubelet starts it again", lambda: empty.restarts("navigation") == 1, PATIENCE_S)
    heard.until("its wheels do not turn", "robot/navigation/state", lambda reported: reported["doing"] == "idle")
    heard.until("nor have they since", "robot/navigation/odometry", lambda reported: reported["travelled"] < 0.01)


def test_a_robot_whose_lidar_is_gone_stands(heard, empty):
    heard.order("navigation", {"waypoints": [[50, 0]]})
    heard.until("it drives", "robot/navigation/odometry", lambda reported: reported["travelled"] > 0.2)
    empty.stop("lidar")
    heard.until("it is blind", "robot/navigation/state", lambda reported: reported["doing"] == "blind")
