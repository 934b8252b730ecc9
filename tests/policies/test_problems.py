"""What goes wrong is told in the status, and told again when it is over, in virtual time."""

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


def test_a_refused_restore_is_told_while_the_policy_waits_and_when_it_is_over(running):
    running.sample(IMU, speed=0.3)
    running.settle()
    running.cluster.faults += [refusal("Forbidden")] * 3
    done = running.delete(a_policy())
    running.turn(1)
    running.settle()
    status, reason, message = running.condition("Applied")
    assert (status, reason) == ("False", "NotRestored")
    assert message == f"slam: Forbidden: no; {GIVE_UP}"
    assert running.condition("Ready")[0] == "False"
    assert ("RestoreFailed", message) in running.told()
    assert not done.done()
    running.delete(a_policy())  # kopf asks again
    running.settle()
    assert running.told().count(("RestoreFailed", message)) == 1, "it is no news"
    for _ in range(9):
        done = running.delete(a_policy())
        running.turn(10)
        running.settle()
    assert done.done()
    assert running.limits() == {"slam": 400, "speech": 400}
    assert ("ResizeRecovered", "slam can be resized again") in running.told()


def test_a_namespace_that_another_operator_serves_is_forgotten_and_left_as_it_is(running):
    running.sample(IMU, speed=0.3)
    running.settle()
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
    running.sample(IMU, speed=0.0)
    running.settle()
    assert running.limits() == {"slam": 500, "speech": 500}
    assert "ResizedByOther" not in [reason for reason, _ in running.told()], "it knows nothing of before"


def test_an_operator_without_its_lease_is_silent_and_says_the_plan_again_when_it_is_back(running):
    running.fence.open = False
    plans = len(running.session.plans())
    running.sample(IMU, speed=0.3)
    running.settle()
    assert len(running.session.plans()) == plans
    assert running.session.ask("contextpolicy/lab/robot/plan").answers == []
    running.fence.open = True
    running.operator.resume()
    running.turn(1)
    assert running.session.plans()[-1]["contexts"] == ["moving"]


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
    running.operator.pod_gone("uid-slam")
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


def inverse_speed(sample: dict[str, float]) -> float:
    return 1 / sample["speed"]


def test_a_plugged_in_function_that_fails_is_told_until_it_works_again(operator, monkeypatch):
    class Installed:
        name = "caution"

        def load(self):
            return lambda streams, **_: streams["imu"].pipe(operators.map(inverse_speed))

    monkeypatch.setattr(plugins, "entry_points", lambda **_: [Installed()])
    operator.list_all()
    operator.connect()
    operator.apply(a_policy(tasks=[a_task("slam", activity=[{"initiative": "caution"}]), a_task("speech")]))
    operator.sample(IMU, speed=0.0)
    operator.turn(1.0)
    source = "spec.tasks[slam].activity[0].initiative caution"
    told = f"{source}: float division by zero"
    assert operator.condition("StreamsHealthy") == ("False", "ExpressionFailed", told)
    operator.sample(IMU, speed=0.5)
    operator.turn(1.0)
    assert operator.condition("StreamsHealthy")[0] == "True"


def test_an_edit_that_is_refused_is_told_again_when_it_was_mended_in_between(running):
    broken, mended = a_policy(tasks=[]), a_policy()
    for body in (broken, broken, mended, broken):
        running.apply(body)
    assert [reason for reason, _ in running.told() if reason == "Invalid"] == ["Invalid", "Invalid"]


def test_an_error_inside_is_the_callers_and_the_loop_goes_on(running):
    broken: dict[str, Any] = {"metadata": {}}
    future = running.operator.policy_changed(broken)
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
    operator.cluster.policies["lab/robot"] = {}
    future = operator.operator.policy_changed(a_policy())
    assert future.cancel()
    operator.turn()
    operator.sample(IMU, speed=0.3)
    operator.settle()
    assert operator.limits() == {"slam": 800, "speech": 200}
    with pytest.raises(CancelledError):
        future.result()
