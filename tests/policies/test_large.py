"""Many policies, and one as large as the definition admits: each decides, and none keeps another from deciding."""

from __future__ import annotations

import json

import pytest

from contextpolicy.errors import PolicyError
from contextpolicy.policy.fields import MOST_FINDINGS
from contextpolicy.policy.parsing import parse
from tests.cluster.builders import a_pod
from tests.planning.builders import a_context, a_stream, a_task
from tests.policies.builders import IMU, a_policy, resources
from tests.virtual_operator import VirtualOperator

POLICIES = 30
MEGABYTE = 1_000_000
TASKS, CONTEXTS, NAME = 128, 64, 63
"""The most that the definition admits of each, and the longest name."""


def numbered(number):
    """A policy whose speech is suspended while its own robot moves."""
    slam, speech = (a_task(f"{name}-{number}", max="500m") for name in ("slam", "speech"))
    return a_policy(
        name=f"robot-{number}",
        streams=[a_stream("imu", key=f"robot-{number}/imu")],
        tasks=[slam, speech],
        contexts=[a_context("moving", "imu.speed > 0.1", {speech["name"]: {"suspend": True}})],
    )


def a_pod_on(node, name):
    pod = a_pod(name, {name: resources()})
    pod["spec"]["nodeName"] = node
    return pod


@pytest.fixture
def fleet():
    """Thirty policies, two tasks each, on a node for each policy."""
    placed = [(f"{name}-{number}", f"node-{number}") for number in range(POLICIES) for name in ("slam", "speech")]
    operator = VirtualOperator(*(a_pod_on(node, name) for name, node in placed))
    operator.list_all()
    for number in range(POLICIES):
        operator.node(name=f"node-{number}")
    operator.connect()
    for number in range(POLICIES):
        operator.apply(numbered(number))
    operator.settle()
    return operator


def test_thirty_policies_decide_independently(fleet):
    moving = set(range(0, POLICIES, 3))
    for number in range(POLICIES):
        fleet.sample(f"robot-{number}/imu", speed=0.3 if number in moving else 0.0)
    fleet.settle()
    limits = fleet.limits()
    assert {number for number in range(POLICIES) if limits[f"speech-{number}"] == 10} == moving
    assert {limits[f"slam-{number}"] for number in range(POLICIES)} == {500}
    for number in range(POLICIES):
        assert fleet.condition("Ready", f"lab/robot-{number}")[0] == "True"


def the_largest():
    """More than 1 MB, nearly all of it effects of contexts on tasks."""
    names = ["slam", "speech", *(f"task-{number:03}-".ljust(NAME, "x") for number in range(TASKS - 2))]
    effects = {name: {"weight": number + 0.1234567890123, "suspend": False} for number, name in enumerate(names)}
    never = [
        a_context(f"never-{number}".ljust(NAME, "x"), _condition(number), effects) for number in range(CONTEXTS - 1)
    ]
    moving = a_context("moving", "imu.speed > 0.1", {"speech": {"suspend": True}})
    return a_policy(tasks=[a_task(name) for name in names], contexts=[*never, moving])


def _condition(number):
    """A condition as long as may be."""
    return f"imu.speed > {100 + number}".ljust(1000)


@pytest.fixture
def robot():
    """Two tasks of each policy run, on a node for each."""
    placed = {"slam": "node-1", "speech": "node-1", "slam-0": "node-0", "speech-0": "node-0"}
    operator = VirtualOperator(*(a_pod_on(node, name) for name, node in placed.items()))
    operator.list_all()
    for node in ("node-0", "node-1"):
        operator.node(name=node)
    operator.connect()
    operator.apply(numbered(0))
    return operator


def test_a_policy_of_a_megabyte_decides_and_keeps_no_other_from_deciding(robot):
    largest = the_largest()
    assert len(json.dumps(largest)) > MEGABYTE
    robot.apply(largest)
    for key in (IMU, "robot-0/imu"):
        robot.sample(key, speed=0.3)
    robot.settle()
    limits = robot.limits()
    assert (limits["speech"], limits["speech-0"]) == (10, 10)
    assert robot.condition("Accepted")[:2] == ("True", "Valid")


def test_an_invalid_policy_is_refused_with_few_words():
    """Each mistake names what there is: 100 kB of unknown tasks made 8 MB of findings in half a minute."""
    names = [f"task-{number:03}-".ljust(NAME, "x") for number in range(TASKS)]
    effects = {f"other-{number:03}-".ljust(NAME, "x"): {"weight": 1} for number in range(TASKS)}
    contexts = [a_context(f"c{number}", "imu.x > 1.0", effects) for number in range(8)]
    unknown = [a_context("unknown", "||".join(f"s{number}.x>1.0" for number in range(80)), {})]
    for body in (a_policy(tasks=[a_task(name) for name in names], contexts=contexts), a_policy(contexts=unknown)):
        with pytest.raises(PolicyError) as caught:
            parse(body)
        assert 80 <= len(caught.value.findings) <= MOST_FINDINGS
        assert len(str(caught.value)) < 300_000


def test_a_policy_with_many_unknown_fields_is_refused_with_few_words():
    with pytest.raises(PolicyError) as caught:
        parse(a_policy(**{f"unknown{number}": 1 for number in range(2 * MOST_FINDINGS)}))
    assert len(caught.value.findings) == MOST_FINDINGS
