"""A shadow beside its policy, promoted and reverted, in virtual time."""

from __future__ import annotations

import json

import pytest

from tests.planning.builders import a_context, a_stream, a_task
from tests.policies.builders import IMU, a_policy

HALF = {"slam": {"weight": 5}, "speech": {"weight": 5}}
LATER = "2026-01-02T00:00:00Z"


def a_shadow(mode="DryRun", generation=1, name="robot-next", of="robot", **spec):
    """While the robot moves both get the same."""
    contexts = [a_context("moving", "imu.speed > 0.1", HALF)]
    full = {"mode": mode, "shadow": {"of": of}, "contexts": contexts, **spec}
    return a_policy(name=name, generation=generation, created=LATER, **full)


@pytest.fixture
def beside(running):
    """The shadow of a robot that moves."""
    running.apply(a_shadow())
    running.react(IMU, speed=0.3)
    return running


@pytest.fixture
def promoted(beside):
    misses(beside, 60, 0.01)
    beside.apply(a_shadow("Enforce", generation=2))
    beside.settle()
    return beside


def misses(operator, seconds, part, task="slam", *, suspended=False):
    """A report each second, while the robot goes on."""
    for _ in range(seconds):
        operator.sample(IMU, speed=0.3)
        said = json.dumps({"misses": part, "suspended": suspended}).encode()
        operator.session.deliver_bytes("robot/*/health", said, f"robot/{task}/health")
        operator.turn(1.0)
    operator.settle()


def shadow_of(operator):
    operator.turn(1.0)
    return operator.cluster.statuses["lab/robot-next"]["shadow"]


def test_a_shadow_resizes_nothing_and_reports_its_difference(beside):
    assert beside.limits() == {"slam": 800, "speech": 200}
    assert shadow_of(beside)["difference"] == "slam 800m -> 500m, speech 200m -> 500m"
    assert beside.condition("Ready", "lab/robot-next")[0] == "True"
    assert beside.condition("Applied", "lab/robot-next") == ("True", "DryRun", "")


def test_its_difference_follows_the_other_policy(beside):
    beside.apply(a_policy(generation=2, contexts=[a_context("moving", "imu.speed > 0.1", HALF)]))
    beside.settle()
    assert shadow_of(beside)["difference"] == ""


def test_a_promoted_shadow_replaces_the_policys_spec(promoted):
    assert promoted.limits() == {"slam": 500, "speech": 500}
    assert promoted.condition("Applied", "lab/robot-next") == ("True", "Promoted", "")
    assert promoted.condition("Applied") == ("True", "InForce", "")
    assert promoted.cluster.statuses["lab/robot"]["promotedShadow"] == "robot-next"
    assert ("Promoted", "robot now runs with this spec") in promoted.reported()


def test_the_plan_key_stays_the_same_after_promotion(promoted):
    spoken = [(key, plan["mode"]) for key, plan in promoted.session.published if plan and key.endswith("/plan")]
    assert ("contextpolicy/lab/robot/plan", "Enforce") in spoken
    assert ("contextpolicy/lab/robot-next/plan", "Enforce") not in spoken


def test_a_promotion_moves_only_what_the_shadow_changes(beside):
    """Originals are not restored in between, and active contexts stay active."""
    resized = beside.resizes_while(lambda: beside.apply(a_shadow("Enforce", generation=2)))
    assert resized == [("slam", {"slam": "500m"}), ("speech", {"speech": "500m"})]


def test_a_rise_in_misses_reverts_the_promotion(promoted):
    misses(promoted, 10, 0.9)
    assert promoted.limits() == {"slam": 800, "speech": 200}
    status, reason, message = promoted.condition("Applied", "lab/robot-next")
    assert (status, reason) == ("False", "Reverted")
    assert "slam has missed" in message
    assert promoted.condition("Ready", "lab/robot-next")[0] == "False"
    assert promoted.condition("Ready")[0] == "True"
    assert promoted.cluster.statuses["lab/robot"]["promotedShadow"] is None
    assert [reason for reason, _ in promoted.reported()].count("Reverted") == 2
    assert shadow_of(promoted)["reverted"]["generation"] == 2


@pytest.mark.parametrize(
    "health", [{"part": 0.02}, {"part": 1.0, "suspended": True}, {"part": 1.0, "task": "stranger"}]
)
def test_misses_that_do_not_rise_revert_nothing(promoted, health):
    misses(promoted, 60, **health)
    assert promoted.limits() == {"slam": 500, "speech": 500}


def test_its_status_reports_the_misses_before_and_since(promoted):
    misses(promoted, 20, 0.03)
    promoted.apply(a_shadow("Enforce", generation=3))
    assert shadow_of(promoted)["tasks"] == [
        {"name": "slam", "missesBefore": 0.01, "misses": pytest.approx(0.03, abs=0.002)}
    ]


def test_its_status_reports_the_misses_before_as_soon_as_they_are_known(beside):
    misses(beside, 20, 0.01)
    assert shadow_of(beside)["tasks"] == [{"name": "slam", "missesBefore": pytest.approx(0.01)}]


def test_a_reverted_shadow_stays_reverted_until_edited(promoted):
    misses(promoted, 10, 0.9)
    taken = promoted.cluster.statuses["lab/robot-next"]
    promoted.apply({**a_shadow("Enforce", generation=2), "status": taken})
    promoted.settle()
    assert promoted.limits() == {"slam": 800, "speech": 200}
    promoted.apply({**a_shadow("Enforce", generation=3), "status": taken})
    promoted.settle()
    assert promoted.limits() == {"slam": 500, "speech": 500}


def restarted(operator, *bodies):
    calls = len(operator.cluster.calls)
    statuses = dict(operator.cluster.statuses)
    operator.start()
    operator.list_all()
    operator.connect()
    for body in bodies:
        operator.apply({**body, "status": statuses[f"lab/{body['metadata']['name']}"]})
        operator.sample(IMU, speed=0.3)
    operator.settle()
    return operator.cluster.calls[calls:]


def test_a_new_operator_moves_nothing_of_a_promoted_shadow(promoted):
    assert restarted(promoted, a_policy(), a_shadow("Enforce", generation=2)) == []
    assert promoted.limits() == {"slam": 500, "speech": 500}
    misses(promoted, 60, 0.03)
    assert promoted.limits() == {"slam": 500, "speech": 500}, "it knows what was missed before"


def test_a_restarted_operator_remembers_a_reverted_shadow(promoted):
    misses(promoted, 10, 0.9)
    assert restarted(promoted, a_shadow("Enforce", generation=2), a_policy()) == []
    assert promoted.condition("Applied", "lab/robot-next")[1] == "Reverted"


def test_a_new_operator_does_not_wait_for_ever_for_a_shadow_that_is_gone(promoted):
    restarted(promoted, a_policy())
    promoted.turn(2.0)
    promoted.react(IMU, speed=0.3)
    assert promoted.limits() == {"slam": 800, "speech": 200}


def test_a_shadow_that_is_deleted_gives_the_policy_back_to_itself(promoted):
    done = promoted.delete(a_shadow("Enforce", generation=2))
    promoted.settle()
    assert done.done()
    assert promoted.limits() == {"slam": 800, "speech": 200}


def test_adopting_a_shadows_spec_resizes_nothing(promoted):
    """The policy gets the shadow's spec, then the shadow goes: as `kubectl ctxp adopt` does it, or two commits."""
    calls = len(promoted.cluster.calls)
    promoted.apply(a_policy(generation=2, contexts=[a_context("moving", "imu.speed > 0.1", HALF)]))
    promoted.settle()
    promoted.delete(a_shadow("Enforce", generation=2))
    promoted.settle()
    assert promoted.cluster.calls[calls:] == []


@pytest.mark.parametrize(("mode", "limits"), [("Paused", 400), ("DryRun", 400)])
def test_pausing_a_policy_pauses_its_shadow(promoted, mode, limits):
    promoted.apply(a_policy(generation=2, mode=mode))
    promoted.settle()
    assert promoted.limits() == {"slam": limits, "speech": limits}


def test_a_context_that_is_forced_on_the_policy_holds(promoted):
    promoted.sample(IMU, speed=0.0)
    promoted.turn(5)
    force = {"context": "moving", "until": "2033-05-18T03:33:20Z"}
    promoted.apply(a_policy(generation=2, force=force))
    promoted.turn(1.0)
    assert promoted.cluster.statuses["lab/robot"]["activeContexts"] == ["moving"]


def test_only_one_shadow_is_promoted(promoted):
    promoted.apply(a_shadow("Enforce", name="robot-too"))
    promoted.settle()
    assert promoted.condition("Applied", "lab/robot-too") == (
        "False",
        "NotApplied",
        "lab/robot-next is already promoted: only one shadow of a policy can be",
    )
    assert promoted.limits() == {"slam": 500, "speech": 500}


@pytest.mark.parametrize("of", ["nobody", "robot-next"])
def test_shadow_of_an_unknown_policy_lists_the_running_ones(beside, of):
    beside.apply(a_shadow(name="lost", of=of))
    beside.settle()
    status, reason, message = beside.condition("Accepted", "lab/lost")
    assert (status, reason) == ("False", "Conflicted")
    assert message == f"spec.shadow.of: invalid value '{of}': expected a running policy of namespace lab: one of robot"
    assert beside.limits() == {"slam": 800, "speech": 200}


def test_a_shadow_is_accepted_once_its_policy_exists(operator):
    operator.govern(a_shadow("Enforce"))
    operator.settle()
    assert operator.condition("Accepted", "lab/robot-next")[0] == "False"
    operator.apply(a_policy())
    operator.react(IMU, speed=0.3)
    assert operator.condition("Accepted", "lab/robot-next")[0] == "True"
    assert operator.limits() == {"slam": 500, "speech": 500}


def test_a_task_that_a_shadow_no_longer_has_is_not_in_its_status(beside):
    misses(beside, 20, 0.01)
    misses(beside, 20, 0.01, task="speech")
    assert [task["name"] for task in shadow_of(beside)["tasks"]] == ["slam", "speech"]
    beside.apply(a_shadow(generation=2, tasks=[a_task("slam")], contexts=[]))
    beside.settle()
    assert [task["name"] for task in shadow_of(beside)["tasks"]] == ["slam"]


def test_an_invalid_edit_of_a_promoted_shadow_leaves_it_promoted(promoted):
    promoted.apply(a_shadow("Enforce", generation=3, tasks=[a_task("slam", min="2", max="1")]))
    promoted.settle()
    assert promoted.limits() == {"slam": 500, "speech": 500}
    assert promoted.condition("Accepted", "lab/robot-next")[:2] == ("False", "Invalid")


def test_a_policy_without_a_shadow_subscribes_to_no_health(running):
    keys = [subscriber.key for subscriber in running.session.subscribers]
    assert keys == ["contextpolicy/agents/*/confirmed", IMU]


def test_deleting_the_shadow_unsubscribes_from_health(beside):
    assert "robot/*/health" in [subscriber.key for subscriber in beside.session.subscribers]
    beside.delete(a_shadow())
    assert "robot/*/health" not in [subscriber.key for subscriber in beside.session.subscribers]


def test_a_recording_has_the_spec_that_decided(promoted):
    promoted.loop.inline = True
    recorded = promoted.operator.queries.recording("lab/robot", 300)
    assert recorded["policy"]["metadata"]["name"] == "robot"
    assert recorded["policy"]["spec"]["contexts"] == a_shadow()["spec"]["contexts"]
    assert recorded["policy"]["spec"].keys().isdisjoint({"shadow", "mode"})


def test_there_is_no_recording_of_a_policy_that_does_not_run(promoted):
    promoted.loop.inline = True
    assert promoted.operator.queries.recording("lab/other", 300) is None


def test_a_stream_that_only_the_shadow_has_is_known_when_it_is_promoted(running):
    """The shadow has read it before: the promoted plan is at once the one that was shown."""
    streams = [a_stream("imu", staleAfter="10s"), a_stream("mode", staleAfter="1h")]
    contexts = [a_context("careful", "mode.careful", HALF)]
    running.apply(a_shadow(streams=streams, contexts=contexts))
    running.sample("robot/mode", careful=True)
    running.react(IMU, speed=0.3)
    running.apply(a_shadow("Enforce", generation=2, streams=streams, contexts=contexts))
    running.settle()
    assert running.limits() == {"slam": 500, "speech": 500}
