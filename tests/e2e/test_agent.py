"""The node agent: ahead of the resize, in agreement with it, and gone without a trace."""

import contextlib
import itertools
import json
import signal
import time

import pytest

from tests.e2e.agents import NAMESPACE, Component, Trace, connect, report
from tests.e2e.cluster import PATIENCE, delete, get, resizes_refused, run, until
from tests.e2e.robot import Robot, Sensors, together
from tests.e2e.test_foreign_writers import resize

GRACE = 10.0
STANDING, MOVING = {"slam": 500, "speech": 500}, {"slam": 990, "speech": 10}


@pytest.fixture(scope="module")
def operator(module):  # noqa: ARG001 - installed with it
    return Component("operator")


@pytest.fixture(scope="module")
def robot(module):
    with Sensors(module) as sensors:
        robot = Robot(NAMESPACE, sensors)
        robot.drive(0.0)
        robot.start("slam", "speech")
        yield robot
        robot.stop("slam", "speech")


@pytest.fixture
def governed(robot, agent):
    agent.wait()
    robot.drive(0.0)
    robot.policy()
    settled(robot, STANDING)
    yield robot
    run("kubectl", "delete", "ctxp", "--all", "-n", robot.namespace, "--timeout=60s")


def api(robot):
    """The limits that the API has, in thousandths of a core."""
    containers = {task: get("pod", task, robot.namespace)["spec"]["containers"][0] for task in ("slam", "speech")}
    texts = {task: container["resources"]["limits"]["cpu"] for task, container in containers.items()}
    return {task: int(text[:-1]) if text.endswith("m") else int(text) * 1000 for task, text in texts.items()}


def settled(robot, limits):
    """The kernel and the API agree on the limits."""

    def agreed():
        seen = robot.limits("slam", "speech"), api(robot)
        return True if seen == (limits, limits) else seen

    until(f"kernel and API have {limits}", agreed)


def in_force(robot, limits):
    cgroups = {task: robot.container(task) for task in limits}
    until(f"the kernel enforces {limits}", lambda: (now := together(cgroups)) == limits or now)


def test_agent_writes_ahead_of_the_resize(governed, module):
    with Trace(governed, module, "slam", "speech") as trace:
        with resizes_refused(NAMESPACE, "slam"):
            governed.drive(0.3)
            in_force(governed, MOVING)
            assert api(governed) == STANDING
        settled(governed, MOVING)
        until("the kubelet reports it", lambda: trace.reported(stage="inForce", container=f"{NAMESPACE}/slam/slam") > 0)
        time.sleep(1)
    assert 0 < trace.reached(**MOVING) < trace.reported(stage="accepted")
    assert trace.limits[-1][1] == MOVING
    assert len(trace.limits) <= 4, "somebody changed the limits again"


def test_rapid_context_changes_converge_without_lasting_excess(governed, module, agent):
    """The kubelet may write a limit of an older plan late; until the agent has corrected that, limits sum above N."""
    restarts = agent.restarts()
    with Trace(governed, module, "slam", "speech") as trace:
        storm = zip(itertools.cycle([0.3, 0.0]), itertools.cycle([0.02, 0.05, 0.1, 0.3, 0.7]), strict=False)
        for flips, (speed, pause) in enumerate(storm):
            if flips >= 40 and len(trace.limits) > 10:
                break
            assert flips < 400, "the limits hardly ever change"
            governed.drive(speed)
            time.sleep(pause)
        governed.drive(0.3)
        settled(governed, MOVING)
    ends = [at for at, _ in trace.limits[1:]]
    excess = [end - at for (at, seen), end in zip(trace.limits, ends, strict=False) if sum(seen.values()) > 1000]
    assert sum(excess) <= 0.01 * (trace.limits[-1][0] - trace.limits[0][0])
    assert sum(trace.limits[-1][1].values()) <= 1000
    assert agent.restarts() == restarts


def test_messages_without_a_signature_change_nothing(governed, module, agent):
    """Not even those of somebody who got hold of the operator's certificate; the agent lives on and does its work."""
    restarts, key = agent.restarts(), f"contextpolicy/{NAMESPACE}/robot/plan"
    reply = next(iter(module.get(key, timeout=PATIENCE))).ok
    good, signature = json.loads(reply.payload.to_bytes()), reply.attachment.to_bytes()
    slam, speech = good["targets"]
    later = good | {"sequence": good["sequence"] + 1, "targets": [slam | {"cores": 0.01}, speech]}
    before = report(module)["refused"]
    with connect("operator") as forger:
        for attachment in (None, signature, b"\0" * len(signature)):
            forger.put(key, json.dumps(later), attachment=attachment)
        forger.delete(key)
        forger.put("*/*/*/plan", json.dumps(later), attachment=signature)

        def all_refused():
            now = report(module)["refused"]
            counts = {reason: now.get(reason, 0) - before.get(reason, 0) for reason in ("Unsigned", "Forged")}
            return counts == {"Unsigned": 2, "Forged": 2} or counts

        until("the agent has refused them all", all_refused)
    assert governed.limits("slam", "speech") == STANDING
    governed.drive(0.3)
    settled(governed, MOVING)
    assert agent.restarts() == restarts


def test_frozen_agent_falls_back_to_resizes(governed, agent):
    """It keeps nobody waiting: the resize comes at once, plan after plan, and the agent is back in its place later."""
    try:
        agent.send(signal.SIGSTOP)
        for speed, limits in ((0.3, MOVING), (0.0, STANDING), (0.3, MOVING)):
            governed.drive(speed)
            settled(governed, limits)
    finally:
        agent.send(signal.SIGCONT)
    governed.drive(0.0)
    settled(governed, STANDING)


def test_a_writer_that_never_stops_wins_in_the_kernel_too(governed):
    """After ten answers; plans go on for the other task."""
    governed.drive(0.3)
    settled(governed, MOVING)
    deadline = time.monotonic() + 150
    while "the operator leaves the change in place" not in governed.condition("Applied")[1]:
        assert time.monotonic() < deadline
        resize(governed, "slam", "300m", "vpa-updater")
    for speed in (0.0, 0.3):
        governed.drive(speed)
        settled(governed, {"slam": 300, "speech": 10 if speed else 500})
    delete("ctxp", "robot", governed.namespace)
    settled(governed, STANDING)


def test_paused_policy_is_released(governed):
    governed.drive(0.3)
    in_force(governed, MOVING)
    governed.policy(mode="Paused")
    settled(governed, STANDING)
    governed.policy()
    settled(governed, MOVING)


@pytest.fixture
def victim(agent):
    """An agent that was never killed before: the kubelet starts it again at once."""
    agent.delete()
    agent.wait()
    return agent


@pytest.mark.parametrize("moment", [0.0, 0.3, 0.55, 1.0])
def test_agent_killed_at_any_moment_converges(victim, governed, moment):
    """After its write (to find its process takes longer than that), before, during and after the resize."""
    governed.drive(0.3)
    time.sleep(moment)
    victim.kill()
    settled(governed, MOVING)
    until("the agent is back", lambda: victim.restarts() == 1)
    governed.drive(0.0)
    settled(governed, STANDING)


def test_an_agent_killed_and_its_policy_deleted_meanwhile(victim, governed):
    governed.drive(0.3)
    in_force(governed, MOVING)
    victim.kill()
    delete("ctxp", "robot", governed.namespace)
    victim.wait()
    time.sleep(GRACE + 2)
    settled(governed, STANDING)


@contextlib.contextmanager
def unconfirmed(robot, operator):
    """The agent has set limits that the API does not know of, and the operator is frozen, not before the moment given.

    A resize would follow the agent within a second: it is refused until then, however long the freezing takes.
    """
    try:
        with resizes_refused(NAMESPACE, "slam"):
            robot.drive(0.3)
            in_force(robot, MOVING)
            frozen = time.monotonic()
            operator.send(signal.SIGSTOP)
        assert api(robot) == STANDING
        yield frozen
    finally:
        operator.send(signal.SIGCONT)


def test_stopped_agent_leaves_the_limits_of_the_api(governed, agent, operator):
    with unconfirmed(governed, operator):
        agent.delete()
        settled(governed, STANDING)
    settled(governed, MOVING)


def test_without_an_operator_unconfirmed_limits_are_undone(governed, operator, module):
    with Trace(governed, module, "slam", "speech") as trace, unconfirmed(governed, operator) as frozen:
        in_force(governed, STANDING)
        assert api(governed) == STANDING
    undone = next(at for at, seen in trace.limits if at > frozen and seen != MOVING)
    assert undone - frozen >= GRACE
    settled(governed, MOVING)


def test_a_container_that_is_restarted_gets_its_share(governed):
    governed.drive(0.3)
    settled(governed, MOVING)
    governed.kill("slam")
    until("the container is back", lambda: governed.restarts("slam") > 0)
    settled(governed, MOVING)
    governed.drive(0.0)
    settled(governed, STANDING)
