"""The CPU that a suspended task keeps."""

from __future__ import annotations

import pytest

from contextpolicy.planning.allocation.enforcement import amounts
from contextpolicy.policy.spec import Control
from tests.planning.builders import Story, a_context, a_policy, a_stream, a_task, on_node, together


def planned(placement, **fields):
    policy = a_policy(
        streams=[a_stream("imu")],
        tasks=[a_task("slam"), a_task("speech", **fields)],
        contexts=[a_context("moving", "imu.speed > 0", {"speech": {"suspend": True}})],
    )
    story = Story(policy, placement)
    story.sample("imu", at=1, speed=1.0)
    return policy, story.last


@pytest.mark.parametrize(("kept", "share"), [(None, 10), ("50m", 50), ("0", 10), ("55m", 60)])
def test_a_suspended_task_claims_what_it_keeps(kept, share):
    _, plan = planned(on_node("slam", "speech"), **({} if kept is None else {"suspendedCpu": kept}))
    assert (plan.tasks["speech"].suspended, plan.tasks["speech"].share) == (True, share)
    assert plan.tasks["slam"].share == 1000 - share


def test_each_of_its_containers_keeps_it():
    _, plan = planned(together(on_node("slam", "speech"), on_node("speech", node="other")), suspendedCpu="50m")
    assert plan.tasks["speech"].share == 100


@pytest.mark.parametrize("control", [Control.SUSPEND, Control.WEIGHT])
def test_it_is_the_quota_of_a_suspended_container(control):
    policy, _ = planned(on_node("slam", "speech"), suspendedCpu="50m")
    assert amounts(control, policy.tasks[1], 10, suspended=True).quota == 50
