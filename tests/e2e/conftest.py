"""A real node, the operator installed with Helm, and a robot in a namespace of its own for each test module."""

from __future__ import annotations

import contextlib
import os

import pytest

from contextpolicy.streams.zenoh_session import open_visitor
from tests.e2e.cluster import REPOSITORY, apply, run
from tests.e2e.robot import Robot, Sensors
from timelines.demo.deploy import free_address

SYSTEM = "e2e-system"
ROBOTS = ("e2e-robot", "e2e-pods")


@pytest.fixture(scope="session", autouse=True)
def _cluster():
    """Fail at once, with what to do, when there is no cluster."""
    if "KUBECONFIG" not in os.environ:
        pytest.exit("no cluster: run `make e2e`, which starts one, or set KUBECONFIG", returncode=1)


@pytest.fixture(scope="session")
def operator():
    """The operator and its router as users install them; watching the robots' namespaces only."""
    for namespace in ROBOTS:
        apply({"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": namespace}})
    chart = str(REPOSITORY / "charts" / "contextpolicy")
    values = {
        "fullnameOverride": "e2e",
        "image.repository": "contextpolicy",
        "image.tag": "dev",
        "router.service.clusterIP": free_address(48),
        "watchNamespaces": "{" + ",".join(ROBOTS) + "}",
    }
    settings = [part for name, value in values.items() for part in ("--set", f"{name}={value}")]
    run(
        *("helm", "upgrade", "--install", "e2e", chart, "--namespace", SYSTEM, "--create-namespace", *settings),
        *("--take-ownership", "--force-conflicts", "--wait", "--timeout", "120s"),
        timeout=150,
    )
    yield SYSTEM
    run("kubectl", "delete", "ctxp", "--all", "-A", "--timeout=60s")
    run("helm", "uninstall", "e2e", "--namespace", SYSTEM, "--wait", "--timeout", "60s")
    run("kubectl", "delete", "namespace", SYSTEM, *ROBOTS, "--timeout=90s")


@pytest.fixture(scope="session")
def session(operator):  # noqa: ARG001 - the router comes with the operator
    """A session on the robot's bus."""
    with open_visitor([f"tcp/{free_address(48)}:7447"], patience=20) as opened:
        yield opened


@pytest.fixture(scope="module")
def robot(session):
    """A standing robot with two idle tasks and no policy yet."""
    with Sensors(session) as sensors:
        robot = Robot("e2e-robot", sensors)
        robot.drive(0.0)
        robot.start("slam", "speech")
        yield robot
        robot.stop("slam", "speech")


@pytest.fixture
def governed(robot):
    """The robot under its policy; after the test the policy is gone and the containers are as they were."""
    robot.drive(0.0)
    robot.policy()
    robot.expect(slam=500, speech=500)
    yield robot
    robot.drive(0.0)
    with contextlib.suppress(AssertionError):
        run("kubectl", "delete", "ctxp", "--all", "-n", robot.namespace, "--timeout=60s")
