"""The status of a policy: its conditions, and the line that sums them up."""

from __future__ import annotations

import jsonschema
import pytest

from contextpolicy.cluster.claims import Claim
from contextpolicy.planning.planner import Planner
from contextpolicy.telemetry.api_text import MAX_MESSAGE, timestamp
from contextpolicy.telemetry.status import (
    NO_ROUTER,
    StatusFacts,
    status,
    waiting,
)
from tests.planning.builders import START, Story, a_context, a_task, on_node, together
from tests.planning.quiet import Quiet
from tests.telemetry.made_status import NOW, SCHEMA, a_robot, condition, made, moving


def test_the_status_of_a_running_robot():
    content = made(moving())
    assert content["observedGeneration"] == 3
    assert (content["activeContexts"], content["contexts"], content["boundTasks"]) == (["moving"], "moving", "2/2")
    assert content["plan"]["run"] == 17
    assert content["plan"]["time"] == timestamp(START + 1)
    assert content["nodes"] == [{"name": "robot", "capacity": "1", "allocatable": "1", "dividedBy": "Weight"}]
    [node] = made(moving(), shared={"robot": "lab/other come first"})["nodes"]
    assert node["message"] == "lab/other come first"
    slam, speech = content["tasks"]
    assert (slam["weight"], slam["share"], slam["suspended"], slam["pods"]) == (1, "990m", False, 1)
    assert (speech["weight"], speech["share"], speech["suspended"], speech["pods"]) == (0, "10m", True, 1)
    assert content["streams"] == [{"name": "imu", "healthy": True, "message": ""}]
    assert [(one["type"], one["status"]) for one in content["conditions"]] == [
        (name, "True") for name in ("Ready", "Accepted", "Connected", "StreamsHealthy", "Feasible", "Bound", "Applied")
    ]


def test_more_nodes_than_the_definition_allows_are_counted():
    nodes = [on_node("slam", node=f"node-{number:03}") for number in range(70)]
    story = Story(a_robot(), together(*nodes))
    story.sample("imu", at=1, speed=0.3)
    content = made(story)
    assert [node["name"] for node in content["nodes"]] == [f"node-{number:03}" for number in range(64)]
    assert content["moreNodes"] == 6
    assert "moreNodes" not in made(moving())


def test_requests_are_scaled_by_the_factor_that_fits_the_node():
    story = moving(tasks=[a_task("slam", max="500m"), a_task("speech")], enforcement={"control": "Weight"})
    assert made(story)["nodes"][0]["requestFactor"] == 0.667
    assert "requestFactor" not in made(story, agents=frozenset({"robot"}))["nodes"][0]
    assert "requestFactor" not in made(moving(enforcement={"control": "Suspend"}))["nodes"][0]


def test_before_the_first_plan():
    planner = Planner(a_robot(), Quiet(), {})
    content = status(planner, StatusFacts(1, 1, Claim(planner.placement)), (), NOW)
    assert content["plan"] is None, "that of an earlier operator is removed"
    assert (content["contexts"], content["nodes"]) == ("-", [])
    assert [task["share"] for task in content["tasks"]] == ["0", "0"]


def test_several_contexts_stand_in_one_line():
    contexts = [a_context(name, "imu.speed > 0.1") for name in ("moving", "carrying")]
    assert made(moving(contexts=contexts))["contexts"] == "moving, carrying"


def test_needs_that_are_not_met():
    content = made(moving(tasks=[a_task("slam", needs={"cores": 4}), a_task("speech")]))
    assert condition(content, "Feasible") == ("False", "Unmet", "slam: needs 4 cores, but gets 990m")
    assert content["tasks"][0]["message"] == "needs 4 cores, but gets 990m"


def test_obstacles_and_refused_resizes_are_reported():
    content = made(moving(), obstacles={"speech": "no limit"}, unmet_actuation={"slam": "slam: Invalid: no"})
    assert condition(content, "Applied") == ("False", "NotApplied", "no limit; slam: Invalid: no")
    assert [task["message"] for task in content["tasks"]][1] == "no limit"


@pytest.mark.parametrize(("mode", "reason"), [("Enforce", "InForce"), ("DryRun", "DryRun"), ("Paused", "Paused")])
def test_the_reason_of_applied_depends_on_the_mode(mode, reason):
    assert condition(made(moving(mode=mode)), "Applied") == ("True", reason, "")


@pytest.mark.parametrize("mode", ["DryRun", "Paused"])
def test_obstacles_are_not_reported_in_dry_run(mode):
    assert condition(made(moving(mode=mode), obstacles={"speech": "no limit"}), "Applied")[0] == "True"


def test_conflicts_and_a_rejected_edit():
    assert condition(made(moving(), conflicts=["a", "b"]), "Accepted") == ("False", "Conflicted", "a; b")
    rejected = made(moving(), conflicts=["a"], rejected=["spec.tasks: none"])
    assert condition(rejected, "Accepted") == ("False", "Invalid", "spec.tasks: none; a")


def test_realtime_is_reported_only_where_it_is_asked_for():
    assert "Realtime" not in [one["type"] for one in made(moving())["conditions"]]
    content = made(moving(enforcement={"scheduler": "Realtime"}), realtime=["node robot falls back to CFS: no agent"])
    assert condition(content, "Realtime") == ("False", "Unavailable", "node robot falls back to CFS: no agent")


def test_ready_sums_up_with_the_first_problem_of_each():
    content = made(moving(), conflicts=["a", "b"], connected=False, unmet_actuation={"lab/slam": "refused"})
    assert condition(content, "Ready") == (
        "False",
        "Degraded",
        f"Accepted: a; Connected: {NO_ROUTER}; Applied: refused",
    )


def test_silent_streams_and_unmet_floors_do_not_fail_the_policy():
    story = moving(tasks=[a_task("slam", min="900m"), a_task("speech", min="900m", protected=True)], contexts=[])
    story.wait(5)
    content = made(story)
    assert condition(content, "StreamsHealthy")[0] == condition(content, "Feasible")[0] == "False"
    assert condition(content, "Ready") == ("True", "Working", "")


def test_a_lost_bus_is_reported_while_the_last_plan_stays():
    content = made(moving(), connected=False)
    assert condition(content, "Connected") == ("False", "NoRouter", NO_ROUTER)
    assert condition(content, "Ready")[0] == "False"
    assert content["tasks"][0]["share"] == "990m"


def test_messages_are_cut_to_what_the_schema_allows():
    content = made(moving(), conflicts=["x" * 700] * 9, obstacles={"speech": "y" * 5000})
    assert len(condition(content, "Accepted")[2]) == MAX_MESSAGE
    assert len(content["tasks"][1]["message"]) == MAX_MESSAGE


def test_a_policy_of_which_no_version_was_valid():
    content = waiting(["spec.tasks: none", "spec.mode: bad"], 4, (), NOW, connected=True)
    jsonschema.validate(content, SCHEMA)
    assert condition(content, "Accepted") == ("False", "Invalid", "spec.tasks: none; spec.mode: bad")
    assert condition(content, "Connected")[0] == "True"
    assert condition(content, "Ready")[0] == "False"
    assert content["observedGeneration"] == 4


def test_a_policy_that_waits_for_the_router():
    content = waiting((), 1, (), NOW, connected=False)
    jsonschema.validate(content, SCHEMA)
    assert condition(content, "Connected") == ("False", "NoRouter", NO_ROUTER)
    assert condition(content, "Ready")[:2] == ("False", "Degraded")
