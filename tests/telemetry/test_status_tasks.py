"""What the status says of tasks, groups and their pods."""

from __future__ import annotations

from dataclasses import replace

import pytest

from contextpolicy.planning.planner import Planner
from contextpolicy.planning.restart import Remembered
from contextpolicy.telemetry.status import (
    remembered,
)
from tests.planning.builders import Story, a_context, a_parent, a_policy, a_task, on_node
from tests.planning.quiet import Quiet
from tests.telemetry.made_status import NOW, a_robot, condition, made, moving


def test_a_restarted_operator_reads_the_tasks_last_state():
    content, policy = made(moving()), a_robot()
    slam, speech = Remembered(1.0, suspended=False), Remembered(0.0, suspended=True)
    assert remembered(content, policy) == {"slam": slam, "speech": speech}
    assert remembered({**content, "plan": None}, policy) == {}
    assert remembered({"plan": content["plan"], "tasks": [{"name": "slam"}]}, policy) == {}


def test_a_new_pod_is_not_suspended_after_an_operator_restart():
    """Between two pods of a task the operator was killed: the new pod had 10m until its streams were heard."""
    contexts = [a_context("moving", "imu.speed > 0.1", {"slam": {"scale": 2}})]
    story = Story(a_robot(contexts=contexts), replace(on_node("speech"), absent=frozenset({"slam"})))
    content = made(story, absent=frozenset({"slam"}))
    [slam, _] = content["tasks"]
    assert (slam["suspended"], slam["pods"]) == (True, 0)
    policy = story.planner.policy
    following = Planner(policy, Quiet(), remembered(content, policy))
    following.start(NOW)
    following.handle(on_node("slam", "speech"), NOW)
    assert following.last is not None
    assert [task.suspended for task in following.last.tasks.values()] == [False, False]


def test_a_group_has_no_pod_of_its_own_and_is_remembered():
    tasks = [a_parent("both", "slam", "speech"), a_task("slam"), a_task("speech")]
    story = moving(tasks=tasks, contexts=[a_context("moving", "imu.speed > 0.1", {"both": {"suspend": True}})])
    assert remembered(made(story), story.planner.policy)["both"] == Remembered(0.0, suspended=True)


def test_tasks_without_a_container_are_not_bound():
    story = Story(a_robot(), on_node("slam"))
    assert made(story)["boundTasks"] == "1/2"


def test_a_parent_is_reported_but_is_not_a_container():
    policy = a_policy(tasks=[a_parent("drive", "slam", "speech"), a_task("slam"), a_task("speech")])
    content = made(Story(policy))
    assert content["boundTasks"] == "2/2"
    assert [(task["name"], task["pods"]) for task in content["tasks"]] == [("drive", 0), ("slam", 1), ("speech", 1)]


MISNAMED = {
    "slam": "task slam: container: invalid value 'slam': expected one that its pods have, such as slam-1: mapper"
}


def test_a_missing_container_is_named_and_keeps_the_policy_unready():
    content = made(moving(), misnamed=MISNAMED)
    assert condition(content, "Bound") == ("False", "Missing", MISNAMED["slam"])
    assert condition(content, "Ready") == ("False", "Degraded", f"Bound: {MISNAMED['slam']}")
    assert [task["message"] for task in content["tasks"] if task["name"] == "slam"] == [MISNAMED["slam"]]


@pytest.mark.parametrize(("required", "status"), [(True, "False"), (False, "True")])
def test_a_task_without_a_pod_counts_if_it_is_required(required, status):
    story = Story(a_robot(tasks=[a_task("slam"), a_task("speech", required=required)]))
    content = made(story, absent=frozenset({"speech"}))
    assert condition(content, "Ready")[0] == condition(content, "Bound")[0] == status
    reported = "task speech: no running pod has app=speech" if required else ""
    assert condition(content, "Bound")[2] == reported


def test_a_policy_none_of_whose_tasks_has_a_pod_is_not_ready():
    content = made(Story(a_robot()), absent=frozenset({"slam", "speech"}))
    assert condition(content, "Bound")[2].startswith("task slam: no running pod has app=slam; task speech")
    assert condition(content, "Ready")[0] == "False"
