"""Realtime (Eq. 2): budgets and priorities follow the context, hold busy tasks to their part, and are taken back."""

import json
import os
import time

import pytest

from tests.e2e.agents import (
    NAMESPACE,
    PRIORITY,
    SYSTEM,
    budget,
    budgets,
    budgets_above,
    group,
    period,
    policies,
    usage,
)
from tests.e2e.cluster import run, until
from tests.e2e.robot import Robot, Sensors, task

REALTIME, ORDINARY = {(os.SCHED_RR, PRIORITY)}, {(os.SCHED_OTHER, 0)}
TASKS = ("slam", "speech", "spare")
STANDING = {"slam": 50, "speech": 200, "spare": 700}
MOVING = {"slam": 200, "speech": 50, "spare": 700}

BUSY = """
import os
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
while True: pass
"""
"""Never idle, and on one processor: the kernel counts a budget on each processor by itself."""

BIRTHS = """
import subprocess, threading, time
def births():
    while True:
        threading.Thread(target=time.sleep, args=(0.3,)).start()
        subprocess.run(["python3", "-c", "pass"])
births()
"""
"""Threads and processes are born all the time."""

GREEDY = """
import os
os.fork(); os.fork()
while True: pass
"""
"""More busy processes than the node has processors to spare."""

SPEC = {
    "enforcement": {"scheduler": "Realtime"},
    "reserve": 0,
    "tasks": [task("slam", idle=50), task("speech", idle=200), task("spare", idle=700)],
    "contexts": [
        {"name": "moving", "when": "imu.speed > 0.05", "tasks": {"slam": {"weight": 200}, "speech": {"weight": 50}}},
        {"name": "racing", "when": "imu.speed > 5.0", "tasks": {"speech": {"suspend": True}}},
    ],
}
"""The weights sum to the 950 thousandths that there are: a weight is a share. The spare task uses little."""

SUSPENDING = {"name": "moving", "when": "imu.speed > 0.05", "tasks": {"speech": {"suspend": True}}}


@pytest.fixture(scope="module")
def robot(module):
    with Sensors(module) as sensors:
        robot = Robot(NAMESPACE, sensors)
        robot.drive(0.0)
        robot.start("slam", "speech", command=["python3", "-c", BUSY])
        robot.start("spare", command=["python3", "-c", BIRTHS])
        yield robot
        robot.stop(*TASKS)


@pytest.fixture
def governed(robot, agent):
    agent.wait()
    robot.drive(0.0)
    robot.policy(**SPEC)
    expect(robot, STANDING)
    yield robot
    run("kubectl", "delete", "ctxp", "--all", "-n", robot.namespace, "--timeout=60s")
    untouched(robot)


def expect(robot, wanted):
    def seen():
        now = budgets(robot, *wanted)
        return True if now == wanted else now

    until(f"the kernel has the realtime budgets {wanted}", seen)


def untouched(robot):
    """Everything is as it was before any policy."""

    def seen():
        found = (
            [policies(robot, name) for name in TASKS],
            budgets(robot, *TASKS),
            [budgets_above(robot, name) for name in TASKS],
            robot.limits(*TASKS),
        )
        none = [ORDINARY] * 3, dict.fromkeys(TASKS, 0), [[0, 0, 0]] * 3, dict.fromkeys(TASKS, 500)
        return True if found == none else found

    until("nothing is left of realtime", seen)


def condition(robot, status, words):
    def seen():
        now = robot.condition("Realtime")
        return True if now[0] == status and words in now[1] else now

    until(f"condition Realtime is {status}: {words}", seen)


def test_budgets_reach_from_all_pods_down_to_the_container(governed):
    assert budgets_above(governed, "speech") == [200, 950, 950]
    assert budgets_above(governed, "slam") == [50, 950, 950]
    condition(governed, "True", "")


def test_busy_tasks_get_their_share_in_each_context(governed):
    """A fifth and a twentieth of one processor, no more although there is room, and no less although there is not."""
    for speed, wanted in ((0.0, STANDING), (0.3, MOVING)):
        governed.drive(speed)
        expect(governed, wanted)
        time.sleep(1)
        used = usage(governed, "slam", "speech", seconds=5)
        for name in ("slam", "speech"):
            assert used[name] == pytest.approx(wanted[name] / 1000, abs=0.03), used


def test_new_and_existing_threads_run_round_robin(governed):
    for name in TASKS:
        until(f"threads of {name} are in realtime", lambda name=name: policies(governed, name) == REALTIME)
    for _ in range(30):
        assert policies(governed, "spare") == REALTIME
        time.sleep(0.1)


def test_period_and_realtime_policy_are_configurable(governed):
    """The paper's period, and threads that queue; a min of 1 of 2 cores is half of each processor's period."""
    tasks = [task("slam", idle=1, min=1), task("speech", idle=200), task("spare", idle=700)]
    own = {"scheduler": "Realtime", "period": "1s", "realtimePolicy": "FIFO"}
    governed.policy(**SPEC | {"enforcement": own, "tasks": tasks})
    expect(governed, {"slam": 500})
    until("the period is a second", lambda: period(group(governed, "slam")) == 1_000_000)
    until("threads queue", lambda: policies(governed, "slam") == {(os.SCHED_FIFO, PRIORITY)})
    governed.policy(**SPEC)
    expect(governed, STANDING)
    assert period(group(governed, "slam")) == 100_000
    until("threads take turns", lambda: policies(governed, "slam") == REALTIME)


def test_a_suspended_task_leaves_realtime_but_is_not_frozen(governed):
    governed.drive(9.0)
    expect(governed, {"speech": 1})
    until("its threads are ordinary", lambda: policies(governed, "speech") == ORDINARY)
    assert governed.limits("speech") == {"speech": 10}
    used = usage(governed, "speech", seconds=3)["speech"]
    assert 0 < used < 0.03
    governed.drive(0.0)
    expect(governed, STANDING)
    until("it is back in realtime", lambda: policies(governed, "speech") == REALTIME)
    assert governed.limits("speech") == {"speech": 500}


def test_changing_the_scheduler_moves_between_the_two(governed):
    governed.policy(**SPEC | {"enforcement": {"scheduler": "CFS"}})
    governed.expect(slam=110, speech=420)
    assert budgets(governed, *TASKS) == dict.fromkeys(TASKS, 0)
    governed.policy(**SPEC)
    expect(governed, STANDING)
    governed.expect(slam=500, speech=500)


def test_a_killed_agent_continues_where_it_was(governed, agent):
    agent.delete()
    agent.wait()
    expect(governed, STANDING)
    governed.drive(0.3)
    agent.kill()
    agent.wait()
    expect(governed, MOVING)
    until("threads are in realtime", lambda: policies(governed, "speech") == REALTIME)


def test_without_an_agent_the_node_falls_back_to_cfs_and_says_why(governed):
    nowhere = {"spec": {"template": {"spec": {"nodeSelector": {"no-such": "node"}}}}}
    patch = ("kubectl", "patch", "daemonset", "e2e-agent-agent", "-n", SYSTEM, "--type=merge", "-p")
    run(*patch, json.dumps(nowhere))
    try:
        condition(governed, "False", "falls back to CFS: no node agent runs there")
        governed.expect(slam=110, speech=420)
        assert budgets(governed, *TASKS) == dict.fromkeys(TASKS, 0)
    finally:
        run(*patch, json.dumps({"spec": {"template": {"spec": {"nodeSelector": None}}}}))
    condition(governed, "True", "")
    expect(governed, STANDING)


def test_greedy_tasks_starve_neither_the_kubelet_nor_the_operator(governed):
    """Realtime loops want more than the whole node: it stays Ready, and a change of plans takes effect."""
    governed.stop("slam", "speech")
    governed.start("slam", "speech", command=["python3", "-c", GREEDY])
    expect(governed, STANDING)
    governed.policy(**SPEC | {"tasks": [task("slam"), task("speech")], "contexts": [SUSPENDING]})
    expect(governed, {"slam": 475, "speech": 475})
    slam, speech = group(governed, "slam"), group(governed, "speech")
    renewed = lease()
    until("the kubelet renews its lease", lambda: lease() != renewed)
    governed.drive(0.3)
    until("the plan changes", lambda: (budget(slam), budget(speech)) == (949, 1))
    ready = run("kubectl", "get", "nodes", "-o", 'jsonpath={.items[*].status.conditions[?(@.type=="Ready")].status}')
    assert ready == "True"


def lease():
    """When the kubelet last said that it lives."""
    return run("kubectl", "get", "leases", "-n", "kube-node-lease", "-o", "jsonpath={.items[*].spec.renewTime}")
