"""What goes wrong is reported in the status, and so is its end, in virtual time."""

from __future__ import annotations

from concurrent.futures import CancelledError
from typing import Any

import pytest
from reactivex import operators

from contextpolicy.policies import plugins
from contextpolicy.telemetry.status import GIVE_UP
from tests.actuators.resize.fake_cluster import refusal
from tests.planning.builders import a_task
from tests.policies.builders import IMU, a_policy


def test_a_refused_resize_is_reported_and_recovers(running):
    running.cluster.faults.append(refusal("Forbidden"))
    running.react(IMU, speed=0.3)
    assert running.condition("Applied") == ("False", "NotApplied", "speech: Forbidden: no")
    assert ("ResizeFailed", "speech: Forbidden: no") in running.reported()
    running.react(IMU, speed=0.0)
    assert running.condition("Applied")[0] == "True"
    assert ("ResizeRecovered", "speech: updates succeed again") in running.reported()


def test_a_refused_restore_is_reported_until_it_succeeds(running):
    running.react(IMU, speed=0.3)
    running.cluster.faults += [refusal("Forbidden")] * 3
    done = running.delete(a_policy())
    running.turn(1)
    running.settle()
    status, reason, message = running.condition("Applied")
    assert (status, reason) == ("False", "NotRestored")
    assert message == f"slam: Forbidden: no; {GIVE_UP}"
    assert running.condition("Ready")[0] == "False"
    assert ("RestoreFailed", message) in running.reported()
    assert not done.done()
    running.delete(a_policy())  # kopf asks again
    running.settle()
    assert running.reported().count(("RestoreFailed", message)) == 1, "it is no news"
    for _ in range(9):
        done = running.delete(a_policy())
        running.turn(10)
        running.settle()
    assert done.done()
    assert running.limits() == {"slam": 400, "speech": 400}
    assert ("ResizeRecovered", "slam: updates succeed again") in running.reported()


def test_a_namespace_that_another_operator_serves_is_forgotten_and_left_as_it_is(running):
    running.react(IMU, speed=0.3)
    before, calls = running.limits(), len(running.cluster.calls)
    running.operator.abandon("lab")
    running.turn(1)
    running.sample(IMU, speed=0.0)
    running.turn(20)
    running.settle()
    assert (running.limits(), len(running.cluster.calls)) == (before, calls)
    assert running.session.tokens == []
    assert running.operator.queries._recorder.of("lab/robot") is None, "its records take room from other policies'"
    running.apply({**a_policy(), "status": {"originals": running.cluster.policies["lab/robot"]}})
    running.react(IMU, speed=0.0)
    assert running.limits() == {"slam": 500, "speech": 500}
    assert "ResizedByOther" not in [reason for reason, _ in running.reported()], "it knows nothing of before"


def test_an_operator_publishes_nothing_without_its_lease_and_republishes_on_return(running):
    running.fence.open = False
    plans = len(running.session.plans())
    running.react(IMU, speed=0.3)
    assert len(running.session.plans()) == plans
    assert running.session.ask("contextpolicy/lab/robot/plan").answers == []
    running.fence.open = True
    running.operator.resume()
    running.turn(1)
    assert running.session.plans()[-1]["contexts"] == ["moving"]


def test_a_resize_that_the_kubelet_holds_back_is_reported(running):
    waits = {"type": "PodResizePending", "status": "True", "reason": "Deferred", "message": "node is full"}
    running.cluster.pods["uid-slam"]["status"]["conditions"].append(waits)
    running.cluster._commit("uid-slam")
    running.settle()
    status, reason, message = running.condition("Applied")
    assert (status, reason) == ("False", "NotApplied")
    assert message.startswith("slam: Deferred: node is full; its CPU request does not fit")
    assert ("ResizePending", message) in running.reported()
    running.cluster.pods["uid-slam"]["status"]["conditions"].remove(waits)
    running.cluster._commit("uid-slam")
    running.settle()
    assert running.condition("Applied")[0] == "True"


def test_problems_of_a_removed_pod_are_cleared(running):
    waits = {"type": "PodResizePending", "status": "True", "reason": "Deferred", "message": "node is full"}
    running.cluster.pods["uid-slam"]["status"]["conditions"].append(waits)
    running.cluster._commit("uid-slam")
    running.settle()
    running.operator.pod_gone("uid-slam")
    running.cluster.remove("uid-slam")
    running.settle()
    assert running.condition("Applied")[0] == "True"


def test_a_silent_stream_is_reported_and_heard_again(running):
    running.turn(11.0)
    running.turn(1.0)
    assert running.condition("StreamsHealthy")[:2] == ("False", "Silent")
    assert "stream imu (robot/imu) is silent" in running.condition("StreamsHealthy")[2]
    running.sample(IMU, speed=0.3)
    running.turn(1.0)
    assert running.condition("StreamsHealthy")[0] == "True"


def inverse_speed(sample: dict[str, float]) -> float:
    return 1 / sample["speed"]


def test_a_plugged_in_function_that_fails_is_reported_until_it_works_again(operator, monkeypatch):
    class Installed:
        name = "caution"

        def load(self):
            return lambda streams, **_: streams["imu"].pipe(operators.map(inverse_speed))

    monkeypatch.setattr(plugins, "entry_points", lambda **_: [Installed()])
    operator.govern(a_policy(tasks=[a_task("slam", activity=[{"initiative": "caution"}]), a_task("speech")]))
    operator.sample(IMU, speed=0.0)
    operator.turn(1.0)
    source = "spec.tasks[slam].activity[0].initiative caution"
    reported = f"{source}: float division by zero"
    assert operator.condition("StreamsHealthy") == ("False", "ExpressionFailed", reported)
    operator.sample(IMU, speed=0.5)
    operator.turn(1.0)
    assert operator.condition("StreamsHealthy")[0] == "True"


def test_a_rejected_edit_is_reported_again_after_a_good_one(running):
    broken, corrected = a_policy(tasks=[]), a_policy()
    for body in (broken, broken, corrected, broken):
        running.apply(body)
    assert [reason for reason, _ in running.reported() if reason == "Invalid"] == ["Invalid", "Invalid"]


def test_an_internal_error_reaches_the_caller_and_the_loop_continues(running):
    broken: dict[str, Any] = {"metadata": {"namespace": "lab", "name": "broken"}, "status": {"conditions": 5}}
    future = running.operator.policy_changed(broken)
    with pytest.raises(TypeError):
        running.turn()
    assert isinstance(future.exception(), TypeError)
    running.loop.stop()
    running.react(IMU, speed=0.3)
    assert running.limits() == {"slam": 800, "speech": 200}


def test_a_cancelled_caller_does_not_stop_the_change(operator):
    operator.list_all()
    operator.connect()
    operator.cluster.policies["lab/robot"] = {}
    future = operator.operator.policy_changed(a_policy())
    assert future.cancel()
    operator.turn()
    operator.react(IMU, speed=0.3)
    assert operator.limits() == {"slam": 800, "speech": 200}
    with pytest.raises(CancelledError):
        future.result()
