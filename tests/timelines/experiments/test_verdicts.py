"""What a goal says of runs whose every input is known."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.timelines.experiments.made_up import SCHEDULE, a_run, at_speed, evidence
from timelines.experiments import tables
from timelines.experiments.configurations import CONFIGURATIONS
from timelines.experiments.goals import GOALS, Goal
from timelines.experiments.metrics import (
    METRICS,
    Pair,
    Run,
    accuracy,
    coverage,
    cpu_per_input,
    critical_hits,
    slowest,
    worst_context,
)
from timelines.experiments.record import RecordError, block, packed, records
from timelines.experiments.verdicts import judged, verdicts

HITS = Goal("hits", "heavy", "weights", "alone", "critical hit rate", offset=-0.02)


def pair(record, base):
    return Pair(SCHEDULE, record, base)


def test_at_most_ten_goals_are_declared_and_each_can_be_measured():
    assert 0 < len(GOALS) <= 10
    assert len({goal.name for goal in GOALS}) == len(GOALS)
    for goal in GOALS:
        assert goal.metric in METRICS
        assert {goal.configuration, goal.against} <= CONFIGURATIONS.keys()


def test_each_context_is_judged_by_its_own_task_over_what_was_due_in_it():
    found = critical_hits(pair(a_run("weights", slam="iiiid" + "sssss", speech="lllll" + "iiiio"), a_run("alone")))
    assert found == {"drive: slam": (0.8, 1.0, 5), "talk: speech": (0.8, 1.0, 5)}
    assert worst_context(pair(a_run("weights", slam="iiidd" + "sssss"), a_run("linux", speech="o" * 10))) == {
        "worst context": (0.6, 0.0, 1)
    }


def test_what_was_suspended_although_its_context_wants_it_is_missed():
    found = critical_hits(pair(a_run("weights", slam="ssiii" + "sssss"), a_run("alone")))
    assert found["drive: slam"].value == pytest.approx(0.6)


def test_late_is_covered_and_not_hit():
    run = Run(SCHEDULE, a_run("linux", slam="illdd" + "iiiii"))
    assert run.tally("slam", "drive").hit == pytest.approx(0.2)
    assert run.tally("slam", "drive").coverage == pytest.approx(0.6)
    assert coverage(pair(run.record, a_run("linux")))["drive: slam"][:2] == (0.6, 1.0)


def test_a_frame_of_which_slam_trusts_no_pose_is_not_covered():
    lost = a_run("weights", trusted="11001" + "00000")
    assert coverage(pair(lost, a_run("linux", trusted="1" * 10)))["drive: slam"][:2] == (0.6, 1.0)
    assert critical_hits(pair(lost, a_run("linux")))["drive: slam"].value == 1.0


def test_onsets_are_counted_and_reported_apart():
    run = Run(SCHEDULE, a_run("linux", slam="diiii" + "sssss"))
    assert run.tally("slam", "drive").due == 5
    assert run.tally("slam", "drive", onset=True).hit == 0
    assert run.tally("slam", "drive", onset=False).hit == 1


def test_what_is_never_done_has_the_longest_response():
    found = slowest(pair(a_run("linux", slam="i" * 3 + "dd" + "i" * 5), a_run("linux")))
    assert found["slam"][:2] == (60.0, 0.05)


def test_a_single_one_of_few_inputs_is_not_their_tail():
    """The p99 of ten is the slowest: one lost picture would decide for a whole block."""
    for due, undone, tail in ((20, 1, 0.05), (20, 2, 60.0), (500, 2, 0.05), (500, 3, 60.0)):
        long = replace(SCHEDULE, keys={key: [10 * n / due for n in range(due)] for key in SCHEDULE.keys})
        assert Run(long, a_run("linux", "d" * undone + "i" * (due - undone), "i" * due)).tail("slam") == tail


def test_cpu_is_that_of_the_same_inputs():
    found = cpu_per_input(pair(a_run("weights", slam="i" * 5 + "s" * 5, cpu=0.03), a_run("linux")))
    assert found["all tasks"].value == pytest.approx(1.5)


def test_cpu_of_faster_processors_counts_as_more():
    found = cpu_per_input(pair(at_speed(a_run("weights"), 1.5), at_speed(a_run("linux"), 1.2)))
    assert found["all tasks"].value == pytest.approx(1.25)


def test_a_centimetre_of_trajectory_error_weighs_two_points():
    before = a_run("linux", accuracy={"slam": ["ATE", 0.05, "m", 100, False]})
    after = a_run("weights", accuracy={"slam": ["ATE", 0.06, "m", 100, False]})
    value, base, _ = accuracy(pair(after, before))["slam"]
    assert base - value == pytest.approx(0.02)


def test_a_task_without_results_was_wrong_throughout():
    before = a_run("linux", accuracy={"speech": ["commands heard", 75.0, "%", 4, True]})
    assert accuracy(pair(a_run("weights"), before))["speech"] == (0.0, 0.75, 4)


def test_no_trajectory_is_worse_than_none():
    """Else one run that went astray would outweigh nine that did not."""
    astray = a_run("linux", accuracy={"slam": ["ATE", 5.0, "m", 100, False]})
    assert accuracy(pair(astray, astray))["slam"][:2] == (0.0, 0.0)


def test_the_accuracy_of_a_critical_task_is_that_in_its_context():
    """As coverage is; what signs lose while the robot drives is tabulated."""
    own, whole = ["signs read", 100.0, "%", 3, True], ["signs read", 40.0, "%", 10, True]
    speech = ["commands heard", 75.0, "%", 4, True]
    before = a_run("linux", accuracy={"speech": speech, "talk: speech": own, "signs": own})
    after = a_run("weights", accuracy={"speech": whole, "talk: speech": own, "signs": whole})
    assert accuracy(pair(after, before)) == {"talk: speech": (1.0, 1.0, 3)}


def test_wheel_commands_count_the_frames_that_are_due():
    due, times = Run(SCHEDULE, a_run("linux", slam="iidii" + "iiiii")).commands("drive")
    assert (due, times) == (5, [0.06] * 4)


def test_ten_blocks_that_agree_meet_a_goal_and_four_decide_nothing():
    runs = [a_run("weights", block=n) for n in range(10)]
    [met] = verdicts(evidence(*runs, a_run("alone")), [HITS])
    assert (met.met, met.probability) == (True, 1 / 1024)
    [open_] = verdicts(evidence(*runs[:4], a_run("alone")), [HITS])
    assert (open_.met, open_.probability) == (None, 1 / 16)
    [missed] = verdicts(evidence(*(a_run("weights", slam="d" * 10, block=n) for n in range(5)), a_run("alone")), [HITS])
    assert missed.met is False


def test_a_bad_run_of_a_task_alone_asks_for_no_less():
    """Else half of the blocks would be compared with it, and one run would decide for five."""
    alone = [a_run("alone", slam="iiidd" + "iiiii"), a_run("alone", block=1)]
    runs = [a_run("weights", slam="iiiid" + "iiiii", block=n) for n in range(10)]
    drive = next(case for case in judged(evidence(*runs, *alone), HITS) if case.name == "drive: slam")
    assert (drive.base, drive.gain.pairs) == (1.0, 10)
    assert drive.gain.mean == pytest.approx(-0.18)


def test_stories_of_a_block_count_by_what_is_due_in_them():
    """Else one picture of eight would weigh twice as much as one of sixteen."""
    often = replace(SCHEDULE, keys={key: [n / 2 for n in range(20)] for key in SCHEDULE.keys})
    short = [a_run(name, slam=slam) for name, slam in (("weights", "iiiid" + "iiiii"), ("alone", "i" * 10))]
    long = [a_run(name, "i" * 20, "i" * 20, story="hotel") for name in ("weights", "alone")]
    found = replace(evidence(*short, *long), schedules={"library": SCHEDULE, "hotel": often})
    drive = next(case for case in judged(found, HITS) if case.name == "drive: slam")
    assert drive.value == pytest.approx(14 / 15)
    assert drive.gain.mean == pytest.approx(14 / 15 - 0.98)


def test_a_few_blocks_that_fall_short_decide_nothing_yet():
    """A goal is missed early only where its interval says so, of as many blocks as a test takes."""
    short, well = ("iiiid" + "iiiii", "i" * 10)
    for slams, met in (((short,), None), ((short, *[well] * 5), None), ((short,) * 5, False)):
        runs = [a_run("weights", slam=slam, block=block) for block, slam in enumerate(slams)]
        assert verdicts(evidence(*runs, a_run("alone")), [HITS, *GOALS[1:]])[0].met is met


def test_what_ten_blocks_show_neither_way_is_neither_met_nor_missed():
    """One miss of fifty inputs is within the two points, and would have been called missed."""
    slams = ["iiiid" + "iiiii", *["i" * 10] * 9]
    runs = [a_run("weights", slam=slam, block=block) for block, slam in enumerate(slams)]
    [found] = verdicts(evidence(*runs, a_run("alone")), [HITS])
    assert (found.met, found.enough) == (None, True)
    assert tables.goals([found]).rstrip().endswith("| not shown |")


def test_so_many_blocks_as_all_goals_together_need_decide():
    """Seven goals: seven blocks that agree have a probability of 7/128."""
    for count, met in ((7, None), (8, True)):
        runs = [a_run("weights", block=n) for n in range(count)]
        goals = [HITS, *(Goal(f"{n}", "light", "x", "y", "tail") for n in range(6))]
        assert verdicts(evidence(*runs, a_run("alone")), goals)[0].met is met


def test_the_least_sure_case_decides():
    runs = [a_run("weights", speech="iiiii" + "iiddd", block=n) for n in range(10)]
    [verdict] = verdicts(evidence(*runs, a_run("alone")), [HITS])
    assert verdict.met is False
    assert verdict.worst is not None
    assert verdict.worst.name == "talk: speech"
    assert verdict.worst.gain.mean == pytest.approx(-0.58)


def test_a_goal_without_runs_is_not_judged_and_still_counts():
    runs = [a_run("weights", block=n) for n in range(10)]
    both = verdicts(evidence(*runs, a_run("alone")), [HITS, Goal("none", "light", "x", "y", "tail")])
    assert [one.met for one in both] == [True, None]
    assert both[0].probability == 2 / 1024


def test_less_time_is_a_gain_where_a_goal_says_at_most():
    goal = Goal("p99", "heavy", "weights", "linux", "tail", factor=1.2, offset=0.005, at_least=False)
    assert goal.gain(0.1, 0.1) == pytest.approx(0.025)


def test_nobody_gains_by_what_is_never_done_under_both():
    """A bound of 1.2 times never would be met by never."""
    goal = next(one for one in GOALS if one.metric == "tail")
    worst = {"slam": "i" * 3 + "dd" + "i" * 5}
    pairs = [a_run(name, load="light", block=n, **worst) for n in range(10) for name in (goal.configuration, "linux")]
    [verdict] = verdicts(evidence(*pairs), [goal])
    [slam] = [case for case in verdict.cases if case.name == "slam"]
    assert (slam.gain.mean, slam.probability, verdict.met) == (0.0, 1.0, None)


def test_a_block_survives_its_file():
    runs = [a_run("linux", slam="ildso" + "iiiii"), a_run("weights")]
    data = block(runs)
    assert records(data) == [runs[0], runs[1]]
    assert block(runs) == data  # the same runs, the same bytes


def test_another_file_is_refused():
    with pytest.raises(RecordError, match="format"):
        records(packed({"format": 0}))
    with pytest.raises(RecordError, match="not valid packed"):
        records(b"nothing")
