"""Nothing outlives what decided it: agent and operator end in every order while a task is suspended.

Within a minute each container has what the plan wants, where an operator lives, or what it had before any policy.
"""

import contextlib
import signal
import time
from pathlib import Path

import pytest

from tests.e2e.agents import NAMESPACE, RELEASE, SYSTEM, Component, install_command
from tests.e2e.cluster import PATIENCE, apply, get, run, until
from tests.e2e.robot import Robot, Sensors
from tests.node import access
from tests.node.images import reference

MOVING = {"Limit": {"slam": 990, "speech": 10}, "Weight": {"slam": 500, "speech": 10}}
ORIGINAL = {"slam": 500, "speech": 500}
SETTLED = 26.0
"""Seconds until all has happened that may undo or repeat a limit: the supervisor acts 10 s after the agent's death, the
operator writes once more 15 s after it has noticed."""
MINUTE = 60.0
own_node = pytest.mark.skipif(access.user_cluster() is not None, reason="takes images away: not on yours")


@pytest.fixture(scope="module")
def robot(module):
    with Sensors(module) as sensors:
        robot = Robot(NAMESPACE, sensors)
        robot.start("slam", "speech")
        yield robot
        robot.stop("slam", "speech")


@pytest.fixture(scope="module")
def operator(module):  # noqa: ARG001 - installed with it
    return Component("operator")


@pytest.fixture
def control():
    """A test may name another one."""
    return "Weight"


@pytest.fixture
def moving(control):
    """What the kernel has while the robot moves."""
    return MOVING[control]


@pytest.fixture
def suspended(robot, agent, control, moving):
    """A robot that moves, so that its speech is suspended, in the API too."""
    agent.wait()
    robot.drive(1.0)
    robot.policy(enforcement={"control": control})
    in_force(robot, moving)
    until("the API has it too", lambda: robot.api_limit("speech") == "10m" or robot.api_limit("speech"))
    yield robot
    run("kubectl", "delete", "ctxp", "--all", "-n", robot.namespace, "--timeout=60s")
    in_force(robot, ORIGINAL)


def in_force(robot, limits, patience=PATIENCE):
    until(f"the kernel has {limits}", lambda: (now := robot.limits(*limits)) == limits or now, patience)


@contextlib.contextmanager
def ends_in(robot, limits):
    """A minute after what happens here the kernel has these limits; not only before anybody has noticed it."""
    yield
    began = time.monotonic()
    time.sleep(SETTLED)
    in_force(robot, limits, MINUTE - (time.monotonic() - began))


@pytest.fixture(scope="module")
def no_image(operator):
    """While it is entered no agent can be started again. What runs goes on; the operator's image has another name."""
    name, kept = reference("contextpolicy"), "localhost/contextpolicy:kept"
    run("ctr", "images", "tag", "--force", name, kept)
    run("kubectl", "set", "image", f"deployment/{RELEASE}", f"operator={kept}", "-n", SYSTEM)
    rolled_out()
    operator.wait()

    @contextlib.contextmanager
    def gone():
        run("ctr", "images", "rm", "--sync", name)
        try:
            yield
        finally:
            run("ctr", "images", "tag", "--force", kept, name)

    yield gone
    run("kubectl", "set", "image", f"deployment/{RELEASE}", "operator=contextpolicy:dev", "-n", SYSTEM)
    rolled_out()
    run("ctr", "images", "rm", kept)


def rolled_out():
    run("kubectl", "rollout", "status", f"deployment/{RELEASE}", "-n", SYSTEM, "--timeout=90s")


@contextlib.contextmanager
def no_operator():
    """None runs, and none comes."""
    scale = ("kubectl", "scale", f"deployment/{RELEASE}", "-n", SYSTEM)
    run(*scale, "--replicas=0", "--timeout=60s")
    try:
        yield
    finally:
        run(*scale, "--replicas=1", "--timeout=60s")
        rolled_out()


@contextlib.contextmanager
def no_daemonset():
    """Its pods are deleted with it."""
    daemonset = get("daemonset", f"{RELEASE}-agent", SYSTEM)
    run("kubectl", "delete", "daemonset", f"{RELEASE}-agent", "-n", SYSTEM, "--timeout=60s")
    try:
        yield
    finally:
        kept = {key: daemonset["metadata"][key] for key in ("name", "namespace", "labels", "annotations")}
        apply({key: daemonset[key] for key in ("apiVersion", "kind", "spec")} | {"metadata": kept})


def test_agent_and_operator_killed_at_once(suspended, agent, operator, moving):
    with ends_in(suspended, moving):
        agent.kill()
        operator.kill()


@own_node
@pytest.mark.parametrize(("control", "later"), [("Weight", 0.0), ("Limit", 5.0), ("Weight", 12.0)])
def test_agent_killed_for_good_and_operator_replaced(suspended, agent, moving, no_image, later):
    """Its supervisor undoes what the API has 10 s later, before or after the next operator has begun."""
    with no_image():
        with ends_in(suspended, moving):
            agent.kill()
            time.sleep(later)
            Component("operator").delete()
        suspended.drive(0.0)
        in_force(suspended, {"speech": 500})
    agent.delete()


def test_the_agents_pod_is_deleted(suspended, agent, moving):
    with ends_in(suspended, moving):
        agent.delete()


def test_a_frozen_agent_is_killed(suspended, agent, moving):
    """What the operator has written in its place is not undone for good by its supervisor."""
    agent.send(signal.SIGSTOP)
    time.sleep(20)
    with ends_in(suspended, moving):
        agent.kill()


def test_the_daemonset_is_deleted(suspended, moving):
    with no_daemonset():
        with ends_in(suspended, moving):
            pass
        suspended.drive(0.0)
        in_force(suspended, {"speech": 500})


def test_operator_gone_for_good_with_a_live_agent(suspended, moving):
    with no_operator(), ends_in(suspended, ORIGINAL):
        pass
    in_force(suspended, moving)


@own_node
def test_operator_gone_for_good_and_agent_killed(suspended, agent, moving, no_image):
    with no_image(), no_operator(), ends_in(suspended, ORIGINAL):
        agent.kill()
    agent.delete()
    in_force(suspended, moving)


@own_node
def test_the_policy_is_deleted_while_no_agent_can_start(suspended, agent, no_image):
    with no_image(), ends_in(suspended, ORIGINAL):
        agent.kill()
        run("kubectl", "delete", "ctxp", "--all", "-n", NAMESPACE, "--timeout=60s")
    agent.delete()


def test_an_upgrade_and_its_rollback(suspended, moving):
    """Each replaces operator and agent."""
    back = ("helm", "rollback", RELEASE, "--namespace", SYSTEM, "--force-conflicts", "--wait", "--timeout", "120s")
    for command in (install_command(**{"operator.logLevel": "DEBUG"}), back):
        with ends_in(suspended, moving):
            run(*command, timeout=150)


def test_uninstalled_chart_leaves_nothing_to_undo(suspended):
    """The sensors can't come back on the bus: the next installation has another authority."""
    try:
        run("helm", "uninstall", RELEASE, "--namespace", SYSTEM, "--wait", "--timeout", "90s")
        in_force(suspended, ORIGINAL)
        assert not noted(), "what lasts in /run until the next boot has nothing left to undo"
    finally:
        run(*install_command(), timeout=150)


def noted():
    """What the agent's journal has; it is out of reach on a cluster that is not ours."""
    journal = Path("/run") / RELEASE / "agent.journal"
    return journal.read_bytes() if access.user_cluster() is None and journal.exists() else b""
