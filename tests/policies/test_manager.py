"""Policies that are edited, paused and deleted, and several of them, in virtual time."""

from __future__ import annotations

import pytest
from prometheus_client import REGISTRY

from contextpolicy.policies import manager
from contextpolicy.policy.tenants import Tenant, Tenants
from contextpolicy.telemetry.reporter import STATUS_INTERVAL
from tests.actuators.resize.fake_cluster import refusal
from tests.cluster.builders import a_pod
from tests.planning.builders import a_context, a_stream, a_task
from tests.policies.builders import IMU, a_policy


def test_an_invalid_edit_keeps_the_last_good_plan_in_force_and_says_why(running):
    running.apply(a_policy(generation=2, tasks=[a_task("slam", min="2", max="1")]))
    running.turn(0.5)
    assert running.condition("Accepted")[:2] == ("False", "Invalid")
    assert "spec.tasks[0].max" in running.condition("Accepted")[2]
    assert running.cluster.statuses["lab/robot"]["observedGeneration"] == 2
    assert running.reported()[-1][0] == "Invalid"
    running.react(IMU, speed=0.3)
    assert running.limits() == {"slam": 800, "speech": 200}


@pytest.mark.parametrize(
    "stream",
    [a_stream("imu", key="robot/**/**"), a_stream("imu", encoding="cdr", type="no_msgs/msg/Such")],
    ids=["key expression", "ROS type"],
)
def test_an_edit_that_only_the_bus_refuses_keeps_the_last_good_plan_too(running, stream):
    running.apply(a_policy(generation=2, streams=[stream]))
    running.turn(0.5)
    assert running.condition("Accepted")[:2] == ("False", "Invalid")
    running.react(IMU, speed=0.3)
    assert running.limits() == {"slam": 800, "speech": 200}


def test_an_edit_keeps_what_the_streams_reported_and_moves_only_what_it_changes(running):
    running.react(IMU, speed=0.3)
    effects = {"slam": {"weight": 7}, "speech": {"weight": 3}}
    edited = a_policy(generation=2, contexts=[a_context("moving", "imu.speed > 0.1", effects)])
    resized = running.resizes_while(lambda: running.apply(edited))
    assert resized == [("slam", {"slam": "700m"}), ("speech", {"speech": "300m"})]


@pytest.mark.parametrize("streams", [[a_stream("imu", staleAfter="10s")], [a_stream("imu")]], ids=["watched", "plain"])
def test_an_edit_without_effect_resizes_nothing(operator, streams):
    """In particular, it doesn't restore the originals for a moment."""
    operator.govern(a_policy(streams=streams))
    operator.react(IMU, speed=0.3)
    calls = len(operator.cluster.calls)
    operator.session.published.clear()
    operator.apply(a_policy(generation=2, streams=streams, reserve="0"))
    operator.settle()
    assert operator.cluster.calls[calls:] == []
    assert operator.limits() == {"slam": 800, "speech": 200}
    assert all(len(plan["targets"]) == 2 for plan in operator.session.plans()), "agents act on every message"


def test_a_restarted_operator_resizes_nothing_if_limits_are_right(running):
    running.react(IMU, speed=0.3)
    running.turn(2 * STATUS_INTERVAL)
    calls = len(running.cluster.calls)
    left = {**running.cluster.statuses["lab/robot"], "originals": dict(running.cluster.policies["lab/robot"])}
    running.start()
    running.govern({**a_policy(), "status": left})
    running.turn(1.0)
    running.react(IMU, speed=0.3)
    assert running.cluster.calls[calls:] == []


def test_a_policy_without_a_watched_stream_starts_without_a_restore(running):
    """Its first plan is made before it is known where the containers run."""
    plain = a_policy(streams=[a_stream("imu")], contexts=[], tasks=[a_task("slam", priority=4), a_task("speech")])
    running.apply({**plain, "metadata": {**plain["metadata"], "generation": 2}})
    running.settle()
    calls = len(running.cluster.calls)
    running.start()
    running.govern(plain)
    running.settle()
    assert running.cluster.calls[calls:] == []
    assert running.limits() == {"slam": 800, "speech": 200}


def test_deletion_completes_when_originals_are_restored(running):
    running.react(IMU, speed=0.3)
    done = running.delete(a_policy())
    assert not done.done()
    running.patch()
    assert not done.done()
    running.settle()
    assert done.done()
    assert running.limits() == {"slam": 400, "speech": 400}
    assert running.session.plans()[-1] is None, "those who act on its plans must stop"


def measured():
    samples = (sample for family in REGISTRY.collect() for sample in family.samples)
    return {s.name for s in samples if (s.labels.get("namespace"), s.labels.get("name")) == ("lab", "robot")}


def test_metrics_of_a_deleted_policy_are_removed(running):
    running.react(IMU, speed=0.3)
    assert {"contextpolicy_task_weight", "contextpolicy_plans_total", "contextpolicy_resizes_total"} <= measured()
    running.delete(a_policy())
    running.settle()
    assert measured() == set()


def test_a_resize_answer_after_deletion_leaves_no_state(running):
    """Deletion does not wait for terminating pods."""
    running.react(IMU, speed=0.3)
    running.sample(IMU, speed=0.0)
    for uid in running.cluster.pods:
        running.cluster.terminate(uid)
        running.operator.pod_changed(running.cluster.pods[uid])
    done = running.delete(a_policy())
    assert done.done()
    running.cluster.faults.append(refusal("Forbidden"))
    assert len(running.patches.jobs) == 2
    running.patch()
    running.patch()
    assert measured() == set()
    assert running.operator.queries._resizes.problems("lab/robot") == {}


def test_a_policy_that_leaves_is_forgotten_too_when_another_operator_serves_its_namespace(running):
    running.react(IMU, speed=0.3)
    running.cluster.faults += [refusal("Forbidden")] * 9
    running.delete(a_policy())
    running.patch()
    assert running.operator.queries._resizes.problems("lab/robot")
    running.operator.abandon("lab")
    running.cluster.faults.clear()
    running.cluster.statuses.clear()
    running.turn(60.0)
    assert running.resizes_while(lambda: running.turn(STATUS_INTERVAL)) == []
    assert running.limits() == {"slam": 800, "speech": 200}
    assert running.cluster.statuses == {}
    assert measured() == set()
    assert running.operator.queries._resizes.problems("lab/robot") == {}
    assert running.operator.queries._registry.find("lab/robot") is None


def test_deletion_before_the_first_sample_completes_at_once(operator):
    operator.govern(a_policy())
    assert operator.delete(a_policy()).done()


def test_a_policy_that_is_deleted_while_the_router_is_away_is_restored(running):
    running.start()
    running.list_all()
    done = running.delete(a_policy())
    running.settle()
    assert done.done()
    assert running.limits() == {"slam": 400, "speech": 400}


def test_a_cancelled_deletion_still_completes(running):
    done = running.delete(a_policy())
    done.cancel()
    again = running.delete(a_policy())
    running.settle()
    assert again.done()
    assert running.limits() == {"slam": 400, "speech": 400}


@pytest.mark.parametrize("mode", ["Paused", "DryRun"])
def test_pausing_restores_originals_and_resuming_enforces_again(running, mode):
    running.react(IMU, speed=0.3)
    running.apply(a_policy(generation=2, mode=mode))
    running.settle()
    assert running.limits() == {"slam": 400, "speech": 400}
    assert running.condition("Applied")[:2] == ("True", mode)
    assert None in running.session.plans(), "an agent must not act on it either"
    running.apply(a_policy(generation=3))
    running.react(IMU, speed=0.3)
    assert running.limits() == {"slam": 800, "speech": 200}


# several


def two_policies(operator):
    operator.list_all("2")
    operator.connect()
    tasks = {
        name: {"tasks": [a_task(name)], "contexts": [], "streams": [], "reserve": "1"} for name in ("slam", "speech")
    }
    old = a_policy("old", **tasks["slam"])
    young = a_policy("young", created="2026-02-01T00:00:00Z", **tasks["speech"])
    return old, young


def test_streams_beyond_what_the_administrator_allows_are_refused(operator):
    operator.tenants = Tenants({"lab": Tenant(stream_prefixes=("robot",))})
    operator.start()
    operator.govern(a_policy(streams=[a_stream("imu", key="other/imu")]))
    operator.turn(1.0)
    allowed = "a key that the administrator lets namespace lab read: robot/**"
    reported = f"spec.streams[0].key: invalid value 'other/imu': expected {allowed}"
    assert operator.condition("Accepted") == ("False", "Invalid", reported)
    assert "other/imu" not in operator.session.everything_declared()
    operator.apply(a_policy(generation=2))
    operator.turn(1.0)
    assert operator.condition("Accepted")[0] == "True"


@pytest.mark.parametrize("first", [0, 1])
def test_the_older_policy_wins_whichever_is_seen_first(operator, first):
    old, young = two_policies(operator)
    young["spec"] = {**young["spec"], "tasks": [a_task("slam")], "reserve": "500m"}
    for body in (old, young) if first == 0 else (young, old):
        operator.apply(body)
    operator.settle()
    assert operator.limits()["slam"] == 1000
    assert operator.condition("Accepted", "lab/old")[0] == "True"
    assert operator.condition("Accepted", "lab/young")[:2] == ("False", "Conflicted")
    assert "belongs to task slam of lab/old" in operator.condition("Accepted", "lab/young")[2]


def test_a_policy_takes_over_what_an_older_one_leaves(operator):
    old, young = two_policies(operator)
    young["spec"] = {**young["spec"], "tasks": [a_task("slam")], "reserve": "500m"}
    operator.apply(old)
    operator.apply(young)
    operator.settle()
    done = operator.delete(old)
    operator.settle()
    assert done.done()
    assert operator.limits()["slam"] == 1500
    operator.delete(young)
    operator.settle()
    assert operator.limits()["slam"] == 400


def test_a_conflict_is_reported_once_however_often_pods_come_and_go(operator, caplog):
    old, young = two_policies(operator)
    young["spec"] = {**young["spec"], "tasks": [a_task("slam")]}
    operator.apply(old)
    operator.apply(young)
    for n in range(5):
        operator.operator.pod_changed(a_pod(f"other-{n}"))
        operator.turn()
    assert sum("belongs to task slam" in message for message in caplog.messages) == 1
    assert [reason for reason, _ in operator.reported()] == ["Conflicted"]


def test_a_version_whose_runner_cannot_be_made_leaves_the_last_one_running(running, monkeypatch):
    def refuse(*_):
        raise RuntimeError

    with monkeypatch.context() as patched:
        patched.setattr(manager, "PolicyRunner", refuse)
        with pytest.raises(RuntimeError):
            running.apply(a_policy(generation=2))
    running.loop._is_enabled = False  # the real loop goes on after an action that raises
    before = running.limits()
    running.react(IMU, speed=0.3)
    assert running.limits() != before
