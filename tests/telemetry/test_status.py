"""Statuses as values, and all of them against the schema of the custom resource."""

from __future__ import annotations

import json

import jsonschema
import pytest

from contextpolicy.cluster.claims import Claim
from contextpolicy.planning.inputs import Gone
from contextpolicy.telemetry.status import (
    MAX_MESSAGE,
    NO_ROUTER,
    ConditionFinding,
    StatusFacts,
    conditions,
    status,
    timestamp,
    waiting,
)
from tests.crds.schema import schema, strict
from tests.planning.builders import START, Story, a_context, a_parent, a_policy, a_stream, a_task, on_node, together

SCHEMA = strict(schema())["properties"]["status"]
NOW = START + 100


def made(story, *, previous=(), **facts):
    """The status, as the API server would store it."""
    claim = Claim(story.planner.placement, facts.pop("conflicts", []), facts.pop("obstacles", {}))
    claim.realtime = facts.pop("realtime", [])
    claim.shared = facts.pop("shared", {})
    claim.agents = facts.pop("agents", frozenset())
    content = status(story.planner, StatusFacts(3, 17, claim, **facts), previous, NOW)
    stored = {name: value for name, value in json.loads(json.dumps(content)).items() if value is not None}
    jsonschema.validate(stored, SCHEMA)
    return stored


def condition(content, kind):
    [found] = [one for one in content["conditions"] if one["type"] == kind]
    return found["status"], found["reason"], found["message"]


def a_robot(**spec):
    return a_policy(
        **{
            "streams": [a_stream("imu", staleAfter="1s")],
            "tasks": [a_task("slam"), a_task("speech")],
            "contexts": [a_context("moving", "imu.speed > 0.1", {"speech": {"suspend": True}})],
            **spec,
        }
    )


def moving(**spec):
    story = Story(a_robot(**spec))
    story.sample("imu", at=1, speed=0.3)
    return story


def test_a_robot_at_work():
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
        (name, "True") for name in ("Ready", "Accepted", "Connected", "StreamsHealthy", "Feasible", "Applied")
    ]


def test_more_nodes_than_the_definition_allows_are_counted():
    nodes = [on_node("slam", node=f"node-{number:03}") for number in range(70)]
    story = Story(a_robot(), together(*nodes))
    story.sample("imu", at=1, speed=0.3)
    content = made(story)
    assert [node["name"] for node in content["nodes"]] == [f"node-{number:03}" for number in range(64)]
    assert content["moreNodes"] == 6
    assert "moreNodes" not in made(moving())


def test_weights_that_are_requests_come_with_the_factor_that_fits_them_into_the_node():
    story = moving(tasks=[a_task("slam", max="500m"), a_task("speech")], enforcement={"control": "Weight"})
    assert made(story)["nodes"][0]["requestFactor"] == 0.667
    assert "requestFactor" not in made(story, agents=frozenset({"robot"}))["nodes"][0]
    assert "requestFactor" not in made(moving(enforcement={"control": "Suspend"}))["nodes"][0]


def test_before_the_first_plan():
    content = made(Story(a_robot()))
    assert "plan" not in content
    assert (content["contexts"], content["nodes"]) == ("-", [])
    assert [task["share"] for task in content["tasks"]] == ["0", "0"]


def test_no_plan_removes_what_an_earlier_operator_wrote():
    story = Story(a_robot())
    assert status(story.planner, StatusFacts(1, 1, Claim(story.planner.placement)), (), NOW)["plan"] is None


def test_tasks_without_a_container_are_not_bound():
    story = Story(a_robot(), on_node("slam"))
    assert made(story)["boundTasks"] == "1/2"


def test_a_parent_is_told_but_is_no_container():
    policy = a_policy(tasks=[a_parent("drive", "slam", "speech"), a_task("slam"), a_task("speech")])
    content = made(Story(policy))
    assert content["boundTasks"] == "2/2"
    assert [(task["name"], task["pods"]) for task in content["tasks"]] == [("drive", 0), ("slam", 1), ("speech", 1)]


def test_several_contexts_stand_in_one_line():
    contexts = [a_context(name, "imu.speed > 0.1") for name in ("moving", "carrying")]
    assert made(moving(contexts=contexts))["contexts"] == "moving, carrying"


def test_a_silent_stream():
    story = moving()
    story.wait(5)
    content = made(story)
    assert condition(content, "StreamsHealthy") == (
        "False",
        "Silent",
        f"stream imu (robot/imu) is silent: last sample at {timestamp(START + 1)}",
    )
    assert content["streams"][0]["healthy"] is False


def test_a_stream_that_was_never_heard():
    story = Story(a_robot())
    story.take(Gone("imu"), at=0.5)
    assert condition(made(story), "StreamsHealthy")[2] == "stream imu (robot/imu) is silent: no sample yet"


def test_dropped_samples_are_counted_by_reason():
    story = moving()
    for reason in ("undecodable", "undecodable", "overrun"):
        story.planner.on_drop("imu", reason)
    assert made(story)["streams"] == [{"name": "imu", "healthy": True, "message": "overrun: 1; undecodable: 2"}]


def test_an_expression_that_fails():
    story = Story(a_robot())
    story.sample("imu", at=1, speed="fast")
    state, reason, message = condition(made(story), "StreamsHealthy")
    assert (state, reason) == ("False", "ExpressionFailed")
    assert message.startswith("imu.speed > 0.1: ")


def test_needs_that_are_not_met():
    content = made(moving(tasks=[a_task("slam", needs={"cores": 4}), a_task("speech")]))
    assert condition(content, "Feasible") == ("False", "Unmet", "slam: needs 4 cores, gets 990m")
    assert content["tasks"][0]["message"] == "needs 4 cores, gets 990m"


def test_what_cannot_be_resized_and_what_is_refused():
    content = made(moving(), obstacles={"speech": "no limit"}, unmet_actuation={"slam": "slam: Invalid: no"})
    assert condition(content, "Applied") == ("False", "NotApplied", "no limit; slam: Invalid: no")
    assert [task["message"] for task in content["tasks"]][1] == "no limit"


@pytest.mark.parametrize(("mode", "reason"), [("Enforce", "InForce"), ("DryRun", "DryRun"), ("Paused", "Paused")])
def test_what_applied_means_is_the_modes_business(mode, reason):
    assert condition(made(moving(mode=mode)), "Applied") == ("True", reason, "")


@pytest.mark.parametrize("mode", ["DryRun", "Paused"])
def test_obstacles_are_no_problem_to_who_applies_nothing(mode):
    assert condition(made(moving(mode=mode), obstacles={"speech": "no limit"}), "Applied")[0] == "True"


def test_conflicts_and_a_rejected_edit():
    assert condition(made(moving(), conflicts=["a", "b"]), "Accepted") == ("False", "Conflicted", "a; b")
    rejected = made(moving(), conflicts=["a"], rejected=["spec.tasks: none"])
    assert condition(rejected, "Accepted") == ("False", "Invalid", "spec.tasks: none; a")


def test_realtime_is_told_only_where_it_is_asked_for():
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


def test_a_silent_stream_and_a_floor_that_does_not_fit_are_no_failure_of_the_policy():
    story = moving(tasks=[a_task("slam", min="900m"), a_task("speech", min="900m", protected=True)], contexts=[])
    story.wait(5)
    content = made(story)
    assert condition(content, "StreamsHealthy")[0] == condition(content, "Feasible")[0] == "False"
    assert condition(content, "Ready") == ("True", "Working", "")


def test_a_lost_bus_is_told_while_the_last_plan_stays():
    content = made(moving(), connected=False)
    assert condition(content, "Connected") == ("False", "NoRouter", NO_ROUTER)
    assert condition(content, "Ready")[0] == "False"
    assert content["tasks"][0]["share"] == "990m"


def test_an_hour_without_any_sample_is_told_of_a_stream_without_stale_after_too():
    story = Story(a_robot(streams=[a_stream("imu"), a_stream("mic")]))
    health = []
    story.on_each_health(lambda: health.append(condition(made(story), "StreamsHealthy")))
    story.sample("imu", at=1, speed=0.3)
    story.sample("imu", at=1800, speed=0.3)
    story.wait(3600)
    assert health[-1] == ("False", "Silent", "stream mic (robot/mic) had no sample for 1 h: no sample yet")
    story.wait(5399)
    assert len(health) == 2
    story.wait(5400)
    told = f"stream imu (robot/imu) had no sample for 1 h: last sample at {timestamp(START + 1800)}"
    assert health[-1][2].startswith(told)
    assert story.planner.active_contexts(), "its last value still counts"
    story.sample("imu", at=5401, speed=0.3)
    assert [stream["healthy"] for stream in made(story)["streams"]] == [True, False]
    assert len(health) == 4


def test_messages_are_cut_to_what_the_schema_allows():
    content = made(moving(), conflicts=["x" * 700] * 9, obstacles={"speech": "y" * 5000})
    assert len(condition(content, "Accepted")[2]) == MAX_MESSAGE
    assert len(content["tasks"][1]["message"]) == MAX_MESSAGE


# transition times


def at(now, problems=(), previous=(), generation=1):
    return conditions([ConditionFinding("Accepted", "Valid", "Invalid", problems)], generation, previous, now)


def since(found):
    return {one["type"]: one["lastTransitionTime"] for one in found}


def test_a_transition_time_stands_as_long_as_the_state():
    first = at(0)
    later = at(100, previous=first, generation=2)
    assert since(later) == since(first) == {"Ready": timestamp(0), "Accepted": timestamp(0)}
    assert {one["observedGeneration"] for one in later} == {2}


def test_a_transition_time_moves_with_the_state_not_with_its_reason():
    good = at(0)
    bad = at(10, ["a"], good)
    other = at(20, ["b"], bad)
    good_again = at(30, previous=other)
    assert [since(found)["Accepted"] for found in (bad, other, good_again)] == [timestamp(n) for n in (10, 10, 30)]
    assert since(good_again)["Ready"] == timestamp(30)


def test_conditions_of_others_are_not_kept():
    foreign = {"type": "Foreign", "status": "True", "lastTransitionTime": timestamp(0)}
    assert [one["type"] for one in at(10, previous=[foreign])] == ["Ready", "Accepted"]


# no plan at all


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


def test_it_is_told_which_stream_a_condition_waits_for_and_since_when():
    story = moving(
        streams=[a_stream("imu", staleAfter="1s"), a_stream("button")],
        contexts=[a_context("alarm", "imu.speed > 9 || button.pressed", {"speech": {"suspend": True}})],
    )
    health = []
    story.on_each_health(lambda: health.append(made(story)["streams"]))
    told = f"context alarm has been waiting since {timestamp(START)}: button has no value"
    assert [stream["message"] for stream in made(story)["streams"]] == ["", told]
    assert condition(made(story), "StreamsHealthy")[0] == "True"
    story.sample("button", at=1.5, pressed=False)
    assert len(health) == 1
    assert [stream["message"] for stream in made(story)["streams"]] == ["", ""]


@pytest.mark.parametrize(
    ("offset", "off"),
    [
        (-20.0, "20 s behind"),
        (-7200.0, "2 h behind"),
        (-3 * 86400.0, "3 days behind"),
        (-1.8e9, "57 years behind"),
        (7200.0, "2 h ahead of"),
    ],
)
def test_a_stream_says_when_its_timestamps_are_of_another_clock(offset, off):
    story = Story(a_robot())
    for tick in range(20):
        story.sample("imu", at=tick / 10, stamp=tick / 10 + offset, speed=0.3)
    [stream] = made(story)["streams"]
    told = f"its timestamps are of another clock, {off} ours (simulated time, a replay?): the time of arrival counts"
    assert stream["message"].partition("; ")[0] == told
    assert stream["healthy"]
