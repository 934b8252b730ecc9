"""The operator with its agent and router on the machine's node, and a robot."""

import base64
import json

import pytest

from contextpolicy.bus.session import open_visitor
from tests.e2e.cluster import until
from tests.e2e.robot import Sensors
from tests.vm import places
from tests.vm.chart import NAMESPACE, RELEASE, ROUTER
from tests.vm.inside import api, robot

RATE = 2.0


def parts():
    """What the chart runs, with the numbers of what is wanted and what is ready."""
    found = {}
    for one in api.items("apps/v1/deployments", NAMESPACE):
        found[one["metadata"]["name"]] = one["spec"]["replicas"], one["status"].get("readyReplicas", 0)
    for one in api.items("apps/v1/daemonsets", NAMESPACE):
        found[one["metadata"]["name"]] = one["status"]["desiredNumberScheduled"], one["status"].get("numberReady", 0)
    return found


def all_ready():
    now = parts()
    return True if len(now) == 3 and all(wanted == ready > 0 for wanted, ready in now.values()) else now


@pytest.fixture(scope="session")
def installed():
    api.apply(*json.loads(places.INSIDE_CHART.read_text()))
    until("operator, router and agent are ready", all_ready, patience=1200)


@pytest.fixture(scope="session")
def session(installed, tmp_path_factory):  # noqa: ARG001 - the router comes with it
    credentials = tmp_path_factory.mktemp("module")
    for name, content in api.get("secrets", f"{RELEASE}-bus-module", NAMESPACE)["data"].items():
        (credentials / name).write_bytes(base64.b64decode(content))
    with open_visitor([f"tls/{ROUTER}:7447"], patience=120, credentials=credentials) as opened:
        yield opened


@pytest.fixture(scope="session")
def sensors(session):
    with Sensors(session, rate=RATE) as sensors:
        robot.drive(sensors, 0.0)
        robot.start(*robot.TASKS)
        yield sensors


@pytest.fixture
def governed(sensors):
    robot.drive(sensors, 0.0)
    robot.govern()
    robot.agreed(**robot.STANDING)
    yield sensors
    robot.drive(sensors, 0.0)
    robot.let_go()
