"""A recorded run whose every message is known, and what is kept of it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from timelines.demo.deploy import DeployError
from timelines.experiments.accounting import Timing
from timelines.experiments.accuracy import Accuracy
from timelines.experiments.blocks import HEAVY, Trial
from timelines.experiments.collect import record
from timelines.experiments.configurations import LINUX, WEIGHTS_GATED
from timelines.experiments.due import Schedule, Window
from timelines.experiments.executive import KEYWORD, POSE, Pilot, Sent
from timelines.experiments.raw_data import Counters, Result, RunData
from timelines.experiments.stories import HELD_OUT
from timelines.scenarios import mission

BEGIN = 1_795_300_000
S = 1_000_000_000
STEREO = "robot/camera/stereo"
TRIAL = Trial(HEAVY, HELD_OUT[0], WEIGHTS_GATED, 1, 3)
SCHEDULE = Schedule(
    4.0,
    {STEREO: [0.0, 1.0, 2.0, 3.0], "robot/mission": [0.0]},
    {"slam": {"stereo": STEREO}, "navigation": {}},
    {"slam": 0.1},
    [Window(0.0, 4.0, ("drive",), frozenset())],
    [(0.5, 1.7)],
)


def at(seconds):
    return round((BEGIN + seconds) * S)


def plan(sequence, moment, *suspended):
    tasks = {task: {"share": 0.5, "weight": 3.0, "suspended": task in suspended} for task in ("slam", "navigation")}
    return {"run": 1, "sequence": sequence, "time": BEGIN + moment, "contexts": ["drive"], "tasks": tasks}


@pytest.fixture
def run():
    made = RunData(float(BEGIN), {"about": {"load": 0.1, "drained": True}}, {STEREO: float(BEGIN)})
    made.published = {STEREO: [at(0.001), at(1), at(2), at(3)]}
    made.dropped = {"slam": {"stereo": 1}}
    made.done["slam", "stereo"] = {at(0.001): Timing(BEGIN + 0.051, 0.04, 0), at(3): Timing(BEGIN + 3.2, 0.05, 1)}
    made.plans = [plan(1, -5)]
    made.counters["slam"] = [Counters(BEGIN + n / 2, 5 + 0.1 * n) for n in range(7)]
    return made


def test_every_input_of_a_run_is_in_its_record(run):
    kept = record(TRIAL, run, SCHEDULE, {"slam": Accuracy("ATE", 0.012345, "m", 90, more_is_better=False)})
    column = kept.columns["slam"]["stereo"]
    assert (column.fates, column.responses, column.cpu) == ("dxld", [500, 2000], [4000, 5000])
    assert kept.late == {STEREO: [10, 0, 0, 0]}
    assert kept.accuracy["slam"] == ["ATE", 0.0123, "m", 90, False]
    assert (kept.load, kept.story, kept.configuration, kept.block) == ("heavy", "library", "weights-gated", 3)
    assert kept.about == {"load": 0.1, "drained": True, "finished": 3.2, "unheard": {}, "violations": []}


def test_cpu_is_kept_once_a_second_from_the_first_input_on(run):
    assert record(TRIAL, run, SCHEDULE, {}).used == {"slam": [0, 200, 400, 600]}


def test_plans_of_before_the_run_hold_at_its_begin_and_those_that_were_overtaken_are_left_out(run):
    run.plans = [plan(1, -5), plan(2, -1, "slam"), plan(3, 2.5)]
    kept = record(TRIAL, run, SCHEDULE, {})
    assert [(moment, tasks["slam"]) for moment, _, tasks in kept.plans] == [(0, [3.0, 500]), (2500, [3.0, 500])]
    assert kept.columns["slam"]["stereo"].fates == "dssd"


def test_what_the_recording_lacks_is_counted(run):
    run.counted = {"slam": {"stereo": 3}}
    assert record(TRIAL, run, SCHEDULE, {}).about["unheard"] == {"slam/stereo": 1}
    run.about = {"about": {**run.about["about"], "drained": False}}  # it went on while it was asked
    assert record(TRIAL, run, SCHEDULE, {}).about["unheard"] == {}


def test_a_suspension_that_one_plan_after_the_other_has_is_one(run):
    run.plans = [plan(1, -5), plan(2, 1, "slam"), plan(3, 2, "slam"), plan(4, 3), plan(5, 4, "slam")]
    found = [(begin - BEGIN, end - BEGIN) for begin, end in run.away("slam")]
    assert found == [(1, 3), (4, float("inf"))]


def violations(run, schedule=SCHEDULE, trial=TRIAL):
    return record(trial, run, schedule, {}).about["violations"]


def test_a_run_whose_policy_never_saw_a_context_counts_and_says_so(run):
    """As where the operator had lost the mission's stream: what CPU did not move for was missed, not to be repeated."""
    linux = TRIAL._replace(configuration=LINUX)
    for plans in ([], [{**plan(1, -5), "contexts": []}]):
        run.plans = plans
        assert violations(run) == ["no plan had drive"]
        assert violations(run, trial=linux) == []
    run.plans = []
    assert record(linux, run, SCHEDULE, {}).plans == []


def test_a_run_whose_modules_did_not_pause_counts_and_says_so(run):
    run.plans = [plan(1, 0, "slam")]
    times = [n / 20 for n in range(80)]
    run.published = {STEREO: [at(one) for one in times]}
    run.done["slam", "stereo"] = {at(one): Timing(BEGIN + one + 0.01, 0.01, 0) for one in times if one < 0.4}
    often = replace(SCHEDULE, keys={STEREO: times})
    assert "s" in record(TRIAL, run, often, {}).columns["slam"]["stereo"].fates  # what it had in hand it may end
    run.done["slam", "stereo"] = {at(one): Timing(BEGIN + one + 0.01, 0.01, 0) for one in times}
    assert violations(run, often) == ["slam did 70 of 70 inputs while it was suspended"]


def test_a_pose_that_slam_does_not_trust_is_no_pose(run):
    """Each frame has an answer, also when SLAM has lost its way: that covers nothing."""
    states = {0.001: "tracking", 1: "lost", 3: "degraded"}
    run.results[POSE] = [
        Result(BEGIN + seconds, BEGIN + seconds, {"stamp": at(seconds), "state": state})
        for seconds, state in states.items()
    ]
    assert record(TRIAL, run, SCHEDULE, {}).trusted == "1001"


def test_a_wheel_command_follows_from_its_frame(run):
    run.orders = [Sent(POSE, at(0.001), at(0.06)), Sent(POSE, at(3), at(3.21)), Sent(mission.KEY, at(1), at(1.1))]
    done = {0.06: 0.071, 1.1: 1.2}
    run.done["navigation", "order"] = {at(sent): Timing(BEGIN + end, 0.001, 0) for sent, end in done.items()}
    assert record(TRIAL, run, SCHEDULE, {}).commands == [[0, 700]]  # the second order was lost


def test_a_stop_counts_once_from_the_end_of_the_word(run):
    run.orders = [Sent(KEYWORD, at(0.6), at(2.0)), Sent(KEYWORD, at(0.7), at(2.4)), Sent(KEYWORD, at(30), at(31))]
    run.done["navigation", "order"] = {stamp: Timing(stamp / S + 0.1, 0.001, 0) for _, _, stamp in run.orders}
    [[number, latency]] = record(TRIAL, run, SCHEDULE, {}).stops
    assert number == 0
    assert latency == pytest.approx(4000, abs=1)  # 2.1 s after the begin, the word ended at 1.7 s


def test_a_run_whose_player_skipped_inputs_is_rejected(run):
    run.published[STEREO].pop()
    with pytest.raises(DeployError, match="3 inputs on robot/camera/stereo: expected 4"):
        record(TRIAL, run, SCHEDULE, {})


def drives(forward=0.3):
    return {"does": "drive" if forward else "talk", "forward": forward, "stamp": 7}


def test_while_the_mission_drives_each_pose_is_an_order():
    pilot = Pilot()
    assert pilot.hear(POSE, {"stamp": 1}) is None
    assert pilot.hear(mission.KEY, drives()) is None
    assert pilot.hear(POSE, {"stamp": 2}) == ({"drive": {"forward": 0.3, "turn": 0.0}}, 2)


def test_without_a_mission_nothing_is_ordered():
    pilot = Pilot()
    assert pilot.hear(KEYWORD, {"keyword": "stop", "at": 1.5}) is None
    assert pilot.hear(POSE, {"stamp": 1}) is None


def test_a_stop_holds_until_the_mission_goes_on():
    pilot = Pilot()
    pilot.hear(mission.KEY, drives())
    assert pilot.hear(KEYWORD, {"keyword": "left", "at": 1.5}) is None
    assert pilot.hear(KEYWORD, {"keyword": "stop", "at": 1.5}) == ({"stop": True}, 1_500_000_000)
    assert pilot.hear(mission.KEY, drives()) is None  # it is repeated
    assert pilot.hear(POSE, {"stamp": 3}) == ({"stop": True}, 3)
    assert pilot.hear(mission.KEY, drives(0.0)) == ({"stop": True}, 7)
    assert pilot.hear(POSE, {"stamp": 4}) is None
    pilot.hear(mission.KEY, drives())
    assert pilot.hear(POSE, {"stamp": 5}) == ({"drive": {"forward": 0.3, "turn": 0.0}}, 5)
