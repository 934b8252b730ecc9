"""A whole prediction: plans, profiles and a timeline, by task and context."""

from __future__ import annotations

import pytest

from contextpolicy.policy.parsing import parse as parse_policy
from contextpolicy.simulation.comparison import differences
from contextpolicy.simulation.expectations import ExpectationError
from contextpolicy.simulation.expectations import parse as parse_expectations
from contextpolicy.simulation.forecast import ALL, NONE, forecast, stats
from contextpolicy.simulation.forecast_report import as_fields, as_table
from contextpolicy.simulation.profiles import parse_profiles
from contextpolicy.simulation.robot import Robot
from contextpolicy.simulation.run import simulate
from contextpolicy.simulation.server import Fate, Outcome, Work
from contextpolicy.streams.timeline import parse as parse_timeline
from tests.planning.builders import limited


def a_policy(**spec):
    tasks = [
        {"name": name, "selector": {"matchLabels": {"app": name}}, "idle": 1.0, **own}
        for name, own in {"slam": {"needs": {"deadline": "100ms"}}, "speech": {}}.items()
    ]
    moving = {"name": "moving", "when": "imu.speed > 0.1", "tasks": {"speech": {"suspend": True}}}
    streams = [{"name": "imu", "key": "robot/imu"}]
    body = {"streams": streams, "tasks": tasks, "contexts": [moving], **spec}
    return parse_policy({"metadata": {"name": "p", "namespace": "n"}, "spec": limited(body)})


TIMELINE = parse_timeline(
    {
        "name": "t",
        "duration": 20,
        "inputs": [
            {"key": "robot/imu", "encoding": "json", "from": 0, "to": 10, "rate": 10, "value": {"speed": 0.0}},
            {"key": "robot/imu", "encoding": "json", "from": 10, "to": 20, "rate": 10, "value": {"speed": 0.3}},
            {"key": "cam", "encoding": "binary", "from": 0, "to": 20, "dataset": "x/stereo", "rate": 10},
            {"key": "mic", "encoding": "binary", "from": 0, "to": 20, "dataset": "x/audio", "rate": 10},
        ],
    }
)


def profiles(slam=0.06, speech=0.04):
    def one(key, cpu, depth, **more):
        spread = {"mean": cpu, "quantiles": [cpu]}
        return {"inputs": {"x": {"key": key, "depth": depth, "cpu": spread, "service": spread}}, **more}

    return parse_profiles({"tasks": {"slam": one("cam", slam, 1), "speech": one("mic", speech, 50, deadline=1.0)}})


def predict(policy, cost, cores=1000):
    robot = Robot({"robot": cores})
    run = simulate(policy, TIMELINE, robot=robot)
    return run, forecast(policy, TIMELINE, run.plans, cost, until=run.until)


def test_slam_misses_deadlines_at_half_a_core():
    """60 ms of work every 100 ms: at 0.5 cores it falls behind and drops; at 0.99 it is always in time."""
    _, predicted = predict(a_policy(), profiles())
    slam = predicted.tasks["slam"]
    assert slam[NONE].misses > 0.9
    assert slam[NONE].dropped > 5
    moving = slam["moving"]
    assert (moving.inputs, moving.dropped, moving.suspended) == (100, 0, 0)
    assert moving.misses < 0.05
    assert moving.p50 == pytest.approx(0.06, abs=0.005)
    assert slam[ALL].inputs == 200


def test_until_the_cgroup_follows_the_plan_what_held_before_holds():
    """SLAM falls behind at half a core, and has a whole one while the robot moves, from 10 s on."""
    run = simulate(a_policy(), TIMELINE, robot=Robot({"robot": 1000}))
    soon, late = (
        forecast(a_policy(), TIMELINE, run.plans, profiles(), until=run.until, reaction=seconds)
        for seconds in (0.003, 5.0)
    )
    assert soon.tasks["slam"]["moving"].misses < 0.05
    assert late.tasks["slam"]["moving"].misses > 0.4


def test_a_suspended_task_has_no_misses_and_no_work():
    _, predicted = predict(a_policy(), profiles())
    speech = predicted.tasks["speech"]
    assert speech[NONE].misses == 0
    assert speech["moving"].suspended >= 99  # but for the input at which it was when the plan came
    assert speech["moving"].dropped == 0


def test_unused_cpu_is_idle():
    _, predicted = predict(a_policy(), profiles(slam=0.02, speech=0.01), cores=2000)
    assert predicted.idle[NONE] == pytest.approx(2.0 - 0.3, abs=0.02)
    assert predicted.idle["moving"] == pytest.approx(2.0 - 0.2, abs=0.02)


def test_weights_lend_unused_cpu_and_limits_do_not():
    """Speech hardly works, so under weights slam has nearly the whole core."""
    _, limited = predict(a_policy(), profiles(speech=0.001))
    _, weighted = predict(a_policy(enforcement={"control": "Weight"}), profiles(speech=0.001))
    assert limited.tasks["slam"][NONE].misses > 0.5
    assert weighted.tasks["slam"][NONE].misses == 0


def test_a_deadline_is_the_policys_or_else_the_modules():
    _, predicted = predict(a_policy(), profiles())
    assert predicted.deadlines == {"slam": 0.1, "speech": 1.0}


def test_unpredicted_tasks_are_reported():
    cost = parse_profiles(
        {"tasks": {"slam": {"inputs": {"x": {"key": "lost", "depth": 1, "cpu": {"quantiles": [1]}}}}, "arm": {}}}
    )
    _, predicted = predict(a_policy(), cost)
    assert predicted.tasks["slam"] == {}
    assert list(predicted.notes) == [
        "the timeline has no input for slam on lost, or gives no rate: not predicted",
        "there is no profile for speech: it is predicted to use no CPU",
        "the policy has no task arm: its profile is not used",
    ]


def test_the_phase_of_the_periods_is_unknown_and_the_worst_is_reported():
    slam = predict(a_policy(), profiles(slam=0.045))[1].tasks["slam"][NONE]
    assert slam.misses <= slam.worst
    assert slam.done + slam.dropped == pytest.approx(slam.inputs, abs=2)
    quick, slow = (
        Outcome(Work(0.0, "slam", 0, 0.1), Fate.DONE, time, 0, phase) for phase, time in enumerate((0.0, 1.0))
    )
    both = stats([quick, slow], 0.5)
    assert (both.inputs, both.misses, both.worst) == (1, 0.5, 1.0)


def test_the_same_files_give_the_same_prediction():
    assert predict(a_policy(), profiles())[1] == predict(a_policy(), profiles())[1]


def test_realtime_budgets_are_quotas_of_a_longer_period():
    policy = a_policy(enforcement={"scheduler": "Realtime", "period": "1s"})
    _, predicted = predict(policy, profiles(), cores=1000)
    assert predicted.tasks["slam"][NONE].p99 > 0.3


def test_a_realtime_budget_is_one_of_each_processor():
    """60 ms of work every 100 ms, with 0.475 of each processor."""
    _, predicted = predict(a_policy(enforcement={"scheduler": "Realtime", "period": "100ms"}), profiles(), cores=2000)
    assert predicted.tasks["slam"][NONE].misses == 0


def test_the_report_has_a_row_for_each_task_and_context():
    _, predicted = predict(a_policy(), profiles())
    lines = as_table(predicted).splitlines()
    assert [line.split()[:2] for line in lines[1:-1]] == [
        [task, context] for task in ("slam", "speech") for context in ("all", "-", "moving")
    ]
    assert lines[-1].startswith("idle cores: all ")
    fields = as_fields(predicted)
    assert fields["tasks"]["slam"]["deadline"] == 0.1
    assert fields["tasks"]["slam"]["contexts"]["moving"]["done"] == 100


def expect(text):
    return parse_expectations(text, a_policy(), subject="expected.yaml")


def test_misses_can_be_expected_in_an_interval():
    run, predicted = predict(a_policy(), profiles())
    held = "- {from: 11, to: 19, misses: {slam: {max: 0.05}}}"
    assert list(differences(run.plans, expect(held), predicted)) == []
    (broken,) = differences(run.plans, expect("- {from: 0, to: 9, misses: {slam: {max: 0.05}}}"), predicted)
    assert "misses of slam: expected at most 0.05, but 0.9" in str(broken) or "but 1" in str(broken)
    assert "dropped of 91 inputs" in str(broken)


def test_misses_need_an_interval_and_a_known_task():
    with pytest.raises(ExpectationError) as error:
        expect("- {at: 1, misses: {slam: 0}}\n- {from: 0, to: 1, misses: {nobody: 0}}")
    assert [finding.field for finding in error.value.findings] == ["[0].misses", "[1].misses"]
