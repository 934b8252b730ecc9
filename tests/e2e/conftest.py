"""A real node, the operator installed with Helm, and a robot in a namespace of its own for each test module."""

from __future__ import annotations

import contextlib
import os
import time
from pathlib import Path

import pytest

from contextpolicy.bus.session import open_visitor
from tests.e2e.agents import Component, installed
from tests.e2e.cluster import REPOSITORY, apply, helm_command, run
from tests.e2e.robot import Robot, Sensors
from tests.e2e.slow_link import slow_link
from tests.node.layout import NODE_ADDRESS
from timelines.demo.deploy import free_address

SYSTEM = "e2e-system"
ROBOTS = ("e2e-robot", "e2e-pods")
FOLDER = Path(__file__).parent


def pytest_collection_modifyitems(items):
    """All tests of the installation with agents come last, so that it is made once and no other test meets it.

    What takes parts of it away, and in the end all of it, comes after the rest.
    """
    here = [item for item in items if item.path.is_relative_to(FOLDER)]
    ordered = iter(sorted(here, key=lambda item: ("module" in item.fixturenames, item.path.name == "test_undo.py")))
    items[:] = [next(ordered) if item.path.is_relative_to(FOLDER) else item for item in items]


def router():
    """Where the router of the operator under test listens."""
    return f"tcp/{free_address(48)}:7447"


class Fault:
    """One fault while it is looked at; `back` says that from here on the robot must recover."""

    def __init__(self, name, promised):
        self.name, self.promised = name, promised
        self.started = self.recovering = time.monotonic()

    def back(self):
        self.recovering = time.monotonic()


@pytest.fixture(scope="session")
def faults():
    """Notes what each fault promised and how long recovery took; the table ends in build/e2e/faults.md."""
    rows = []

    @contextlib.contextmanager
    def watched(name, promised):
        fault = Fault(name, promised)
        yield fault
        rows.append(f"| {fault.name} | {fault.promised} | kept; {time.monotonic() - fault.recovering:.1f} s |")

    yield watched
    table = ["| fault | promised | seen; time until the newest plan was in force |", "|---|---|---|", *rows]
    folder = REPOSITORY / "build" / "e2e"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "faults.md").write_text("\n".join(table) + "\n")


@pytest.fixture(scope="session")
def operator():
    """The operator and its router as users install them; watching the robots' namespaces only."""
    if "KUBECONFIG" not in os.environ:
        pytest.exit("no cluster: run `make e2e`, which starts one, or set KUBECONFIG", returncode=1)
    for namespace in ROBOTS:
        apply({"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": namespace}})
    values = {
        "fullnameOverride": "e2e",
        "image.repository": "contextpolicy",
        "image.tag": "dev",
        "router.service.clusterIP": free_address(48),
        "watchNamespaces": "{" + ",".join(ROBOTS) + "}",
        "security.enabled": "false",
        "rosTypes": "{robot-types}",
    }
    run(*helm_command("e2e", SYSTEM, values), timeout=150)
    yield SYSTEM
    for namespace in ROBOTS:
        run("kubectl", "delete", "ctxp", "--all", "-n", namespace, "--timeout=60s")
    run("helm", "uninstall", "e2e", "--namespace", SYSTEM, "--wait", "--timeout", "60s")
    run("kubectl", "delete", "namespace", SYSTEM, *ROBOTS, "--timeout=90s")


@pytest.fixture(scope="module")
def link(operator):
    """A way to the API server that can be slow, which the operator takes; the kubelet and the tests take another."""
    with slow_link(NODE_ADDRESS, (NODE_ADDRESS, 6443)) as (link, port):
        service = {"KUBERNETES_SERVICE_HOST": NODE_ADDRESS, "KUBERNETES_SERVICE_PORT": str(port)}
        with operator_environment(operator, service):
            yield link


@contextlib.contextmanager
def operator_environment(system, variables):
    """The operator is started again with these, and in the end without them."""
    change = ("kubectl", "set", "env", "deployment/e2e", "-n", system)
    wait = ("kubectl", "rollout", "status", "deployment/e2e", "-n", system, "--timeout=90s")
    run(*change, *(f"{name}={value}" for name, value in variables.items()))
    try:
        run(*wait)
        yield
    finally:
        run(*change, *(f"{name}-" for name in variables))
        run(*wait)


@pytest.fixture(scope="session")
def session(operator):  # noqa: ARG001 - the router comes with the operator
    """A session on the robot's bus."""
    with open_visitor([router()], patience=20) as opened:
        yield opened


@pytest.fixture
def moving(governed):
    """The robot under its policy, while it moves."""
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    return governed


@pytest.fixture(scope="session")
def module():
    """A session with a module's role, on the bus of the installation that has agents."""
    with installed() as connect, connect("module") as opened:
        yield opened


@pytest.fixture(scope="session")
def agent(module):  # noqa: ARG001 - installed with it
    return Component("agent")


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
def empty(session):
    """A standing robot whose pods the test starts; afterwards nothing of them is left."""
    with Sensors(session) as sensors:
        robot = Robot("e2e-pods", sensors)
        robot.drive(0.0)
        yield robot
        run("kubectl", "delete", "ctxp", "--all", "-n", robot.namespace, "--timeout=60s")
        everything = "pods,limitranges,resourcequotas"
        run("kubectl", "delete", everything, "--all", "-n", robot.namespace, "--timeout=60s")


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
