"""The operator from its watches' news to patches, statuses and messages, in virtual time."""

from __future__ import annotations

import json
from concurrent.futures import CancelledError

import pytest

from contextpolicy.cluster.agents import NO_AGENT
from contextpolicy.telemetry import metrics
from tests.actuators.fake_cluster import UNREACHABLE, refusal
from tests.api.builders import NODE, a_pod, cpu
from tests.planning.builders import a_context, a_stream, a_task
from tests.virtual_operator import VirtualOperator

IMU = "robot/imu"


def a_policy(name="robot", generation=1, created="2026-01-01T00:00:00Z", **spec):
    """While the robot moves slam gets all; else both the same."""
    full = {
        "streams": [a_stream("imu", staleAfter="10s")],
        "tasks": [a_task("slam"), a_task("speech")],
        "contexts": [a_context("moving", "imu.speed > 0.1", {"slam": {"weight": 8}, "speech": {"weight": 2}})],
        **spec,
    }
    metadata = {"name": name, "namespace": "lab", "uid": f"uid-{name}", "generation": generation}
    return {
        "apiVersion": "contextpolicy.dev/v1alpha1",
        "kind": "ContextPolicy",
        "metadata": {**metadata, "creationTimestamp": created},
        "spec": full,
    }


def resources():
    return cpu("10m", "400m")


@pytest.fixture
def operator(monkeypatch):
    return VirtualOperator(monkeypatch, *(a_pod(name, {name: resources()}) for name in ("slam", "speech")))


@pytest.fixture
def running(operator):
    """A robot that stands still, governed."""
    operator.list_all()
    operator.connect()
    operator.apply(a_policy())
    operator.sample(IMU, speed=0.0)
    operator.settle()
    return operator


def test_samples_become_limits(running):
    assert running.limits() == {"slam": 500, "speech": 500}
    running.sample(IMU, speed=0.3)
    running.settle()
    assert running.limits() == {"slam": 800, "speech": 200}
    running.sample(IMU, speed=0.0)
    running.settle()
    assert running.limits() == {"slam": 500, "speech": 500}


def test_status_and_bus_tell_the_same(running):
    running.sample(IMU, speed=0.3)
    running.settle()
    status, plan = running.cluster.statuses["lab/robot"], running.session.plans()[-1]
    assert status["activeContexts"] == plan["contexts"] == ["moving"]
    assert status["plan"]["sequence"] == plan["sequence"]
    assert {task["name"]: task["share"] for task in status["tasks"]} == {"slam": "800m", "speech": "200m"}
    assert {name: task["share"] for name, task in plan["tasks"].items()} == {"slam": 0.8, "speech": 0.2}
    assert running.condition("Ready") == ("True", "Working", "")


def test_what_is_accepted_and_in_force_goes_to_the_bus(running):
    running.session.published.clear()
    running.sample(IMU, speed=0.3)
    running.settle()
    steps = [step for key, step in running.session.published if key == "contextpolicy/lab/robot/applied"]
    assert [(step["stage"], step["container"], step["cores"]) for step in steps] == [
        ("accepted", "lab/speech/speech", 0.2),
        ("inForce", "lab/speech/speech", 0.2),
        ("accepted", "lab/slam/slam", 0.8),
        ("inForce", "lab/slam/slam", 0.8),
    ]
    assert {step["sequence"] for step in steps} == {running.session.plans()[-1]["sequence"]}


# policies


def test_an_invalid_edit_keeps_the_last_good_plan_in_force_and_says_why(running):
    running.apply(a_policy(generation=2, tasks=[a_task("slam", min="2", max="1")]))
    running.turn(0.5)
    assert running.condition("Accepted")[:2] == ("False", "Invalid")
    assert "spec.tasks[0].max" in running.condition("Accepted")[2]
    assert running.cluster.statuses["lab/robot"]["observedGeneration"] == 2
    assert running.told()[-1][0] == "Invalid"
    running.sample(IMU, speed=0.3)
    running.settle()
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
    running.sample(IMU, speed=0.3)
    running.settle()
    assert running.limits() == {"slam": 800, "speech": 200}


def test_a_good_edit_after_an_invalid_one_is_all_well_again(running):
    running.apply(a_policy(generation=2, tasks=[]))
    running.apply(a_policy(generation=3))
    running.settle()
    assert running.condition("Ready") == ("True", "Working", "")


def test_an_edit_keeps_what_the_streams_told_and_moves_only_what_it_changes(running):
    running.sample(IMU, speed=0.3)
    running.settle()
    effects = {"slam": {"weight": 7}, "speech": {"weight": 3}}
    edited = a_policy(generation=2, contexts=[a_context("moving", "imu.speed > 0.1", effects)])
    resized = running.resizes_while(lambda: running.apply(edited))
    assert resized == [("slam", {"slam": "700m"}), ("speech", {"speech": "300m"})]


@pytest.mark.parametrize("streams", [[a_stream("imu", staleAfter="10s")], [a_stream("imu")]], ids=["watched", "plain"])
def test_an_edit_that_changes_nothing_moves_nothing(operator, streams):
    """Least of all does it put containers back for a moment."""
    operator.list_all()
    operator.connect()
    operator.apply(a_policy(streams=streams))
    operator.sample(IMU, speed=0.3)
    operator.settle()
    calls = len(operator.cluster.calls)
    operator.session.published.clear()
    operator.apply(a_policy(generation=2, streams=streams, reserve="0"))
    operator.settle()
    assert operator.cluster.calls[calls:] == []
    assert operator.limits() == {"slam": 800, "speech": 200}
    assert all(len(plan["targets"]) == 2 for plan in operator.session.plans()), "agents act on every message"


def test_a_new_operator_moves_nothing_that_is_right(running):
    running.sample(IMU, speed=0.3)
    running.settle()
    calls = len(running.cluster.calls)
    running.start()
    running.list_all()
    running.connect()
    running.apply(a_policy())
    running.turn(1.0)
    running.sample(IMU, speed=0.3)
    running.settle()
    assert running.cluster.calls[calls:] == []


def test_a_policy_without_a_watched_stream_starts_without_a_restore(running):
    """Its first plan is made before it is known where the containers run."""
    plain = a_policy(streams=[a_stream("imu")], contexts=[], tasks=[a_task("slam", priority=4), a_task("speech")])
    running.apply({**plain, "metadata": {**plain["metadata"], "generation": 2}})
    running.settle()
    calls = len(running.cluster.calls)
    running.start()
    running.list_all()
    running.connect()
    running.apply(plain)
    running.settle()
    assert running.cluster.calls[calls:] == []
    assert running.limits() == {"slam": 800, "speech": 200}


def test_deletion_is_done_when_all_is_as_it_was(running):
    running.sample(IMU, speed=0.3)
    running.settle()
    done = running.delete(a_policy())
    assert not done.done()
    running.patch()
    assert not done.done()
    running.settle()
    assert done.done()
    assert running.limits() == {"slam": 400, "speech": 400}
    assert running.session.plans()[-1] is None, "whoever acts on its plans must stop"


def test_deletion_before_the_first_sample_has_nothing_to_do(operator):
    operator.list_all()
    operator.connect()
    operator.apply(a_policy())
    assert operator.delete(a_policy()).done()


def test_a_policy_that_is_deleted_while_the_router_is_away_is_restored(running):
    running.start()
    running.list_all()
    done = running.delete(a_policy())
    running.settle()
    assert done.done()
    assert running.limits() == {"slam": 400, "speech": 400}


def test_a_deletion_that_nobody_awaits_any_more_is_still_done(running):
    done = running.delete(a_policy())
    done.cancel()
    again = running.delete(a_policy())
    running.settle()
    assert again.done()
    assert running.limits() == {"slam": 400, "speech": 400}


def test_a_restore_that_fails_is_tried_until_it_works(running):
    running.cluster.faults += [UNREACHABLE] * 4
    done = running.delete(a_policy())
    for _ in range(6):
        while running.patches.jobs:
            running.patch()
        running.turn(5.0)
    assert done.done()


@pytest.mark.parametrize("mode", ["Paused", "DryRun"])
def test_a_policy_that_stops_enforcing_puts_all_back_and_takes_it_up_again(running, mode):
    running.sample(IMU, speed=0.3)
    running.settle()
    running.apply(a_policy(generation=2, mode=mode))
    running.settle()
    assert running.limits() == {"slam": 400, "speech": 400}
    assert running.condition("Applied")[:2] == ("True", mode)
    assert None in running.session.plans(), "an agent must not act on it either"
    running.apply(a_policy(generation=3))
    running.sample(IMU, speed=0.3)
    running.settle()
    assert running.limits() == {"slam": 800, "speech": 200}


def test_a_dry_run_says_what_it_would_do(operator, caplog):
    operator.list_all()
    operator.connect()
    with caplog.at_level("INFO"):
        operator.apply(a_policy(mode="DryRun"))
        operator.sample(IMU, speed=0.3)
    assert operator.cluster.calls == []
    assert "dry run: lab/robot would set the CPU of lab/slam/slam to 800m" in caplog.messages


def test_a_paused_policy_hears_nothing(operator):
    operator.list_all()
    operator.connect()
    operator.apply(a_policy(mode="Paused"))
    assert operator.session.subscribers == []
    operator.settle()
    assert operator.condition("Ready")[0] == "True"


# several policies


def two_policies(operator):
    operator.list_all("2")
    operator.connect()
    tasks = {
        name: {"tasks": [a_task(name)], "contexts": [], "streams": [], "reserve": "1"} for name in ("slam", "speech")
    }
    old = a_policy("old", **tasks["slam"])
    young = a_policy("young", created="2026-02-01T00:00:00Z", **tasks["speech"])
    return old, young


def test_two_policies_share_a_node(operator):
    for body in two_policies(operator):
        operator.apply(body)
    operator.settle()
    assert operator.limits() == {"slam": 1000, "speech": 1000}


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


def test_a_conflict_is_told_once_however_often_pods_come_and_go(operator, caplog):
    old, young = two_policies(operator)
    young["spec"] = {**young["spec"], "tasks": [a_task("slam")]}
    operator.apply(old)
    operator.apply(young)
    for n in range(5):
        operator.runtime.pod_changed(a_pod(f"other-{n}"))
        operator.turn()
    assert sum("belongs to task slam" in message for message in caplog.messages) == 1
    assert [reason for reason, _ in operator.told()] == ["Conflicted"]


# the router


def test_policies_wait_for_the_router_and_say_so(operator):
    operator.list_all()
    operator.apply(a_policy())
    operator.turn(0.5)
    assert operator.condition("StreamsHealthy") == ("False", "NoRouter", "no Zenoh router answers yet")
    assert operator.condition("Accepted")[0] == "True"
    assert operator.cluster.calls == []
    operator.connect()
    operator.sample(IMU, speed=0.3)
    operator.settle()
    assert operator.limits() == {"slam": 800, "speech": 200}
    assert operator.condition("Ready")[0] == "True"


def test_an_invalid_policy_is_told_without_a_router(operator):
    operator.apply(a_policy(tasks=[]))
    operator.turn(0.5)
    assert operator.condition("Accepted")[:2] == ("False", "Invalid")
    assert operator.condition("StreamsHealthy")[0] == "True"


# pods and nodes


def test_a_node_that_changes_its_size_changes_n(running):
    running.node("2")
    running.settle()
    assert running.limits() == {"slam": 1000, "speech": 1000}
    running.node("500m")
    running.settle()
    assert running.limits() == {"slam": 250, "speech": 250}


def test_a_node_that_tells_no_size_is_ignored(running):
    running.runtime.node_changed({"metadata": {"name": "joining"}, "status": {}})
    running.turn()
    running.sample(IMU, speed=0.3)
    running.settle()
    assert running.limits() == {"slam": 800, "speech": 200}


def test_pods_known_before_their_node_are_governed_as_soon_as_it_is(operator):
    for pod in operator.cluster.pods.values():
        operator.runtime.pod_changed(pod)
    operator.connect()
    operator.apply(a_policy())
    operator.sample(IMU, speed=0.3)
    assert operator.patches.jobs == []
    operator.node()
    operator.settle()
    assert operator.limits() == {"slam": 800, "speech": 200}


def test_a_pod_that_is_replaced_gets_the_share_of_its_task(running):
    running.sample(IMU, speed=0.3)
    running.settle()
    running.runtime.pod_gone("uid-slam")
    running.cluster.remove("uid-slam")
    running.turn()
    running.cluster.create(a_pod("slam-2", {"slam": resources()}, labels={"app": "slam"}))
    running.settle()
    assert running.limits() == {"slam": 800, "speech": 200}


def test_a_restarted_container_is_told_to_agents_with_the_plan_in_force(running):
    running.session.published.clear()
    running.cluster.pods["uid-slam"]["status"]["containerStatuses"][0]["containerID"] = "containerd://again"
    running.cluster._commit("uid-slam")
    running.settle()
    [plan] = running.session.plans()
    assert plan["edition"] == 1
    assert "containerd://again" in [target["containerId"] for target in plan["targets"]]
    assert "trigger" in plan


def test_a_pod_that_makes_no_sense_is_left_alone(running, caplog):
    running.runtime.pod_changed(a_pod("odd", {"odd": cpu("1m", "many")}))
    running.sample(IMU, speed=0.3)
    running.settle()
    assert running.limits() == {"slam": 800, "speech": 200}
    assert any("pod odd can't be read" in message for message in caplog.messages)


def test_a_guaranteed_pod_grows_and_shrinks(monkeypatch):
    guaranteed = a_pod("slam", {"slam": cpu("400m", "400m", ("64Mi", "64Mi"))}, qos="Guaranteed")
    operator = VirtualOperator(monkeypatch, guaranteed, a_pod("speech", {"speech": resources()}))
    operator.list_all()
    operator.connect()
    still = a_context("still", "imu.speed <= 0.1", {"slam": {"weight": 2}, "speech": {"weight": 8}})
    operator.apply(a_policy(contexts=[*a_policy()["spec"]["contexts"], still]))
    for speed, slam in ((0.3, 800), (0.0, 200), (0.3, 800)):
        operator.sample(IMU, speed=speed)
        operator.settle()
        assert operator.limits() == {"slam": slam, "speech": 1000 - slam}


def test_from_weights_back_to_limits(running):
    running.apply(
        a_policy(generation=2, control="Both", contexts=[], tasks=[a_task("slam", priority=9), a_task("speech")])
    )
    running.settle()
    running.apply(a_policy(generation=3))
    running.sample(IMU, speed=0.3)
    running.settle()
    assert running.limits() == {"slam": 800, "speech": 200}
    assert running.condition("Applied")[0] == "True"


# problems


def test_a_refused_resize_is_told_and_recovers(running):
    running.cluster.faults.append(refusal("Forbidden"))
    running.sample(IMU, speed=0.3)
    running.settle()
    assert running.condition("Applied") == ("False", "NotApplied", "speech: Forbidden: no")
    assert ("ResizeFailed", "speech: Forbidden: no") in running.told()
    running.sample(IMU, speed=0.0)
    running.settle()
    assert running.condition("Applied")[0] == "True"
    assert ("ResizeRecovered", "speech can be resized again") in running.told()


def test_a_resize_that_the_kubelet_holds_back_is_told(running):
    waits = {"type": "PodResizePending", "status": "True", "reason": "Deferred", "message": "node is full"}
    running.cluster.pods["uid-slam"]["status"]["conditions"].append(waits)
    running.cluster._commit("uid-slam")
    running.settle()
    status, reason, message = running.condition("Applied")
    assert (status, reason) == ("False", "NotApplied")
    assert message.startswith("slam: Deferred: node is full; its CPU request doesn't fit")
    assert ("ResizePending", message) in running.told()
    running.cluster.pods["uid-slam"]["status"]["conditions"].remove(waits)
    running.cluster._commit("uid-slam")
    running.settle()
    assert running.condition("Applied")[0] == "True"


def test_somebody_else_who_resizes_is_told_and_gets_nowhere(running):
    running.sample(IMU, speed=0.3)
    running.settle()
    running.cluster.edit("uid-slam", "slam", cpu="300m", by="vpa-updater")
    running.settle()
    assert running.limits() == {"slam": 800, "speech": 200}
    status, _, message = running.condition("Applied")
    assert status == "False"
    assert message.startswith("lab/slam/slam: vpa-updater changed its CPU limit from 800m to 300m; ")
    assert ("ResizedByOther", message) in running.told()
    running.turn(100)
    running.settle()
    assert running.condition("Applied")[0] == "True"


def test_the_problems_of_a_pod_go_with_it(running):
    waits = {"type": "PodResizePending", "status": "True", "reason": "Deferred", "message": "node is full"}
    running.cluster.pods["uid-slam"]["status"]["conditions"].append(waits)
    running.cluster._commit("uid-slam")
    running.settle()
    running.runtime.pod_gone("uid-slam")
    running.cluster.remove("uid-slam")
    running.settle()
    assert running.condition("Applied")[0] == "True"


def test_a_silent_stream_is_told_and_heard_again(running):
    running.turn(11.0)
    running.turn(1.0)
    assert running.condition("StreamsHealthy")[:2] == ("False", "Silent")
    assert "stream imu (robot/imu) is silent" in running.condition("StreamsHealthy")[2]
    running.sample(IMU, speed=0.3)
    running.turn(1.0)
    assert running.condition("StreamsHealthy")[0] == "True"


def test_undecodable_samples_are_counted_in_the_status_and_end_nothing(running):
    for _ in range(3):
        running.session.deliver_bytes(IMU, b"{")
    running.turn(1.0)
    [stream] = running.cluster.statuses["lab/robot"]["streams"]
    assert stream == {"name": "imu", "healthy": True, "message": "undecodable: 3"}
    running.sample(IMU, speed=0.3)
    running.settle()
    assert running.limits() == {"slam": 800, "speech": 200}


def test_an_expression_that_fails_is_told_until_it_works_again(running):
    running.sample(IMU, speed="fast")
    running.turn(1.0)
    assert running.condition("StreamsHealthy")[:2] == ("False", "ExpressionFailed")
    running.sample(IMU, speed=0.0)
    running.turn(1.0)
    assert running.condition("StreamsHealthy")[0] == "True"


def test_an_error_inside_is_the_callers_and_the_loop_goes_on(running):
    broken = {"metadata": {}}
    future = running.runtime.policy_changed(broken)
    with pytest.raises(KeyError):
        running.turn()
    assert isinstance(future.exception(), KeyError)
    running.loop.stop()
    running.sample(IMU, speed=0.3)
    running.settle()
    assert running.limits() == {"slam": 800, "speech": 200}


def test_a_caller_that_gave_up_waiting_harms_nobody(operator):
    operator.list_all()
    operator.connect()
    future = operator.runtime.policy_changed(a_policy())
    assert future.cancel()
    operator.turn()
    operator.sample(IMU, speed=0.3)
    operator.settle()
    assert operator.limits() == {"slam": 800, "speech": 200}
    with pytest.raises(CancelledError):
        future.result()


# agents


def test_a_realtime_policy_without_agents_falls_back_and_says_why(operator):
    operator.list_all()
    operator.connect()
    operator.apply(a_policy(scheduler="Realtime"))
    operator.sample(IMU, speed=0.3)
    operator.settle()
    assert operator.limits() == {"slam": 800, "speech": 200}
    assert operator.condition("Realtime") == ("False", "Unavailable", f"node {NODE} falls back to CFS: {NO_AGENT}")
    assert [reason for reason, _ in operator.told()] == ["RealtimeUnavailable"]


def test_the_nodes_of_realtime_agents_are_left_to_them(operator):
    operator.session.agents[NODE] = json.dumps({"missing": {"CFS": [], "Realtime": []}}).encode()
    operator.list_all()
    operator.connect()
    operator.apply(a_policy(scheduler="Realtime"))
    operator.sample(IMU, speed=0.3)
    operator.turn(10.0)
    operator.settle()
    assert operator.cluster.calls == []
    assert operator.condition("Realtime")[0] == "True"


# start and end


def test_closing_ends_everything_and_leaves_the_limits(running):
    running.sample(IMU, speed=0.3)
    running.settle()
    running.close()
    assert running.session.everything_declared() == []
    assert (running.session.closed, running.cluster.closed) == (True, True)
    assert (running.loop.disposed, running.patches.ended, running.clerks.ended) == (True, True, True)
    assert running.limits() == {"slam": 800, "speech": 200}


def test_closing_before_the_router_was_found(operator):
    operator.list_all()
    operator.close()
    assert operator.cluster.closed


def test_a_loop_that_answers_is_healthy(running):
    running.loop.inline = True
    assert 0 <= running.runtime.delay() < 1


def test_plans_that_min_dwell_held_back_are_counted(operator):
    def counted():
        return metrics.HELD_BACK.labels("lab/robot")._value.get()

    before = counted()
    operator.list_all()
    operator.connect()
    operator.apply(a_policy(minDwell="5s"))
    operator.sample(IMU, speed=0.0)
    operator.turn(6)
    operator.sample(IMU, speed=0.3)
    operator.sample(IMU, speed=0.0)
    operator.turn(6)
    assert counted() == before + 1
