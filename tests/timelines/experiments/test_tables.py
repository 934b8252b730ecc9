"""The report's tables, of runs whose every figure is known."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.timelines.experiments.made_up import SCHEDULE, a_run, at_speed, changed, evidence, some_runs
from timelines.experiments import detail_tables, doubts, tables
from timelines.experiments.blocks import HEAVY, PLAN
from timelines.experiments.evidence import Absent
from timelines.experiments.verdicts import verdicts

SOME = evidence(*some_runs())


def row(text, *begin):
    """The cells of the row that begins with these."""
    found = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines()]
    return next(cells for cells in found if tuple(cells[: len(begin)]) == begin)


def test_each_configuration_has_its_hit_rates_by_context():
    text = tables.of_load(SOME, HEAVY)
    assert row(text, "")[1:4] == ["blocks", "drive: slam", "talk: speech"]
    assert row(text, "Linux default")[1:4] == ["10", "60.0", "100.0"]
    assert row(text, "each task alone")[-3:] == ["-"] * 3


def test_cpu_is_that_of_tasks_of_control_and_of_all_else():
    """All else is the machine's eight seconds without these, and without the one that slows the processors.

    The tasks used 0.03 cores of the 0.392 that were left to them.
    """
    assert row(tables.of_load(SOME, HEAVY), "Linux default")[-3:] == ["8", "0.00", "0.47"]


def test_cpu_can_be_left_out():
    assert row(tables.of_load(SOME, HEAVY, cpu=False), "")[-2:] == ["navigation", "imu"]


def test_faster_processors_leave_fewer_seconds_of_cpu():
    assert row(tables.of_load(evidence(at_speed(a_run("linux"), 2.0)), HEAVY), "Linux default")[-3] == "15"


def test_without_runs_of_a_load_there_is_no_table():
    assert tables.of_load(evidence(a_run("linux", load="light")), HEAVY) == ""


def said_at(begin):
    """A story in which "stop" is said then."""
    return {"library": replace(SCHEDULE, stops=[(begin, begin + 1.2)])}


def test_wheel_commands_are_reported_from_camera_and_word():
    text = tables.chains(replace(SOME, schedules=said_at(2.0)), HEAVY)
    assert row(text, "Linux default") == ["Linux default", "60.0 %", "60 ms", "60 ms", "10 of 10", "800 ms"]


def test_a_stop_counts_only_while_the_wheels_turn():
    text = tables.chains(replace(SOME, schedules=said_at(6.0)), HEAVY)
    assert row(text, "Linux default")[-2:] == ["0 of 0", "-"]


def test_the_median_of_two_stops_is_between_them():
    schedules = {"library": replace(SCHEDULE, stops=[(1.0, 1.5), (3.0, 3.5)])}
    heard = replace(a_run("linux"), stops=[[0, 1000], [1, 3000]])
    text = tables.chains(replace(evidence(heard), schedules=schedules), HEAVY)
    assert row(text, "Linux default")[-2:] == ["2 of 2", "200 ms"]


def test_a_block_without_a_recognised_stop_is_counted_and_has_no_latency():
    unheard = replace(a_run("linux", block=1), stops=[])
    text = tables.chains(replace(evidence(a_run("linux"), unheard), schedules=said_at(2.0)), HEAVY)
    assert row(text, "Linux default")[-2:] == ["1 of 2", "800 ms"]


def test_latencies_have_intervals_over_blocks():
    """Of two blocks one takes 60 ms from each frame to the wheels, the other 100 ms."""
    slow = replace(a_run("linux", block=1), commands=[[number, 1000] for number in range(10)])
    text = tables.chains(evidence(a_run("linux"), slow), HEAVY)
    assert row(text, "Linux default")[2:4] == ["80 [60, 100] ms", "80 [60, 100] ms"]


def test_the_papers_measure_has_a_column_for_each_story():
    assert row(tables.papers(SOME), "exp1", "context limits, gated")[2:] == [*("1.50", "-", "100.0", "0.0", "3", "0")]
    assert row(tables.totals(SOME), "") == ["", "exp1"]
    assert row(tables.totals(SOME), "context limits, gated")[1:] == ["1.50"]
    assert row(tables.totals(SOME), "blocks")[1:] == ["3"]
    assert tables.totals(evidence(a_run("linux"))) == ""


def test_what_the_others_lose_counts_what_no_context_wants_as_well():
    """Else those that are suspended would seem to lose nothing."""
    text = tables.costs(SOME, HEAVY)
    assert row(text, "")[1:] == ["slam", "speech", "commands heard, %", tables.TAKEN]
    assert row(text, "context weights, gated")[1:] == ["50.0", "100.0", "75.0", "8"]
    assert row(text, "Linux default")[1:] == ["30.0", "100.0", "75.0", "8"]
    assert row(text, "each task alone")[1:] == ["100.0", "100.0", "-", "-"]  # as many times as long: nobody's CPU


def test_a_column_in_which_no_division_differs_can_be_left_out():
    text = tables.costs(SOME, HEAVY, ["linux", "weights-gated"], alike=False)
    assert row(text, "")[1:] == ["slam", tables.TAKEN]
    assert row(text, "context weights, gated")[1:] == ["50.0", "8"]


def test_what_is_read_where_it_matters_stands_beside_what_is_read_at_all():
    judged = {"signs": ["signs read", 50.0, "%", 8, True], "read: signs": ["signs read", 100.0, "%", 4, True]}
    text = tables.costs(evidence(a_run("linux", accuracy=judged)), HEAVY)
    assert row(text, "")[-3:] == ["signs read while reading, %", "signs read, %", tables.TAKEN]
    assert row(text, "Linux default")[-3:] == ["100.0", "50.0", "8"]


def given_up(run):
    return replace(run, about={**run.about, "drained": False})


def test_a_run_that_was_given_up_has_no_total_time():
    under = {"load": "paper", "story": "exp3"}
    linux, limits = ([a_run(name, block=block, **under) for block in range(2)] for name in ("linux", "limits-gated"))
    some = evidence(*linux, limits[0], given_up(limits[1]))
    assert row(tables.papers(some), "exp3", "context limits, gated")[2:] == [
        "1.00",
        "-",
        "100.0",
        "0.0",
        "1",
        "1",
    ]
    none = evidence(given_up(linux[0]), limits[0])
    assert row(tables.papers(none), "exp3", "context limits, gated")[2:] == ["-", "-", "100.0", "0.0", "-", "0"]
    assert list(tables.speedups(none)) == []


def test_work_that_was_skipped_stands_beside_the_total_time():
    gated = a_run("limits-gated", slam="i" * 5 + "sssss", load="paper", story="exp3")
    text = tables.papers(evidence(a_run("linux", load="paper", story="exp3"), gated))
    assert row(text, "exp3", "Linux default")[2:] == ["-", "-", "100.0", "0.0", "-", "0"]
    assert row(text, "exp3", "context limits, gated")[4:6] == ["75.0", "25.0"]


def test_a_total_time_stands_beside_that_of_the_same_work_as_well():
    """Else a gated run looks faster than Linux by what it left undone."""
    times = {"linux": 30.0, "linux-gated": 24.0, "limits-gated": 20.0}
    runs = [a_run(name, load="paper", story="exp3") for name in times]
    timed = [replace(one, about={**one.about, "finished": times[one.configuration]}) for one in runs]
    text = tables.papers(evidence(*timed))
    assert row(text, "exp3", "context limits, gated")[2:4] == ["1.50", "1.20"]
    assert row(text, "exp3", "Linux default, gated")[2:4] == ["1.25", "-"]


ABSENT = [Absent("heavy", story, "limits", 0, "no agent") for story in ("library", "hotel")]


def test_what_was_not_run_has_a_row_and_a_reason():
    text = tables.of_load(evidence(a_run("linux"), absent=ABSENT), HEAVY)
    assert row(text, "context limits") == ["context limits", "not run", *["-"] * 7]
    assert tables.absences(evidence(a_run("linux"), absent=ABSENT)) == (
        "- context limits, heavy load, 2 runs: not run: no agent.\n"
    )
    assert tables.absences(SOME) == ""


def test_what_was_not_begun_is_listed():
    every = [
        *(
            a_run(one.name, load=part.load, story=story.name)
            for part in PLAN
            for one in part.configurations
            for story in part.stories
        ),
    ]
    assert tables.not_yet(evidence(*every)) == ""
    some = [run for run in every if run.load not in {"1.6", "unslowed"} and not run.configuration.endswith("adaptive")]
    assert tables.not_yet(evidence(*some)) == (
        "1.6 load, heavy load (Linux default, gated, adaptive; context weights, gated, adaptive), unslowed load"
    )


def test_report_counts_the_solo_runs_that_all_blocks_share():
    assert "alone by story and load: 1. In each case every block" in tables.alone(SOME)
    assert tables.alone(evidence(a_run("linux"))) == ""


def test_other_loads_stand_beside_the_heavy_one():
    """The worst of all contexts in each block, whichever it is."""
    runs = [a_run("static", slam="iiiid" + "iiiii"), a_run("static", slam="i" * 10, speech="i" * 7 + "ddd", block=1)]
    runs += [a_run("static", load="1.1"), a_run("weights", load="1.1")]
    text = tables.sweep(evidence(*runs))
    assert row(text, "static weights")[1:] == ["100.0", "60.0 [40.0, 80.0]"]
    assert row(text, "context weights")[1:] == ["100.0", "-"]
    assert text.startswith("|  | 1.1 | 1.4 |")
    assert tables.sweep(evidence(a_run("static"))) == ""


def test_a_machine_on_which_the_same_inputs_are_less_work_is_a_smaller_load():
    runs = [a_run("linux"), a_run("linux", block=1), a_run("linux", load="1.6", cpu=0.015), a_run("static", load="1.1")]
    assert row(tables.sweep(evidence(*runs)), "work of the same inputs")[1:] == ["-", "100", "75"]


def test_goals_show_their_least_sure_case():
    goal = "each critical or protected task covers as much as alone, less 2 points"
    cells = row(tables.goals(verdicts(SOME)), "heavy", goal)
    assert cells[2:] == ["drive: slam: 1 against 1", "+0.02 [+0.02, +0.02]", "0.00977", "met"]


def test_every_ending_has_its_part():
    cells = row(detail_tables.endings(SOME, HEAVY), "slam", "context weights, gated")
    assert cells[2:] == ["10", "50.0", "0.0", "0.0", "50.0", "0.0", "100.0"]


def test_onsets_stand_beside_what_comes_after_them():
    run = a_run("linux", slam="d" + "i" * 9)
    assert row(detail_tables.onsets(evidence(run), HEAVY), "Linux default", "drive: slam")[2:] == ["0.0", "100.0"]


def test_in_an_onset_each_input_counts_once_whichever_story_it_is_of():
    """One second of a story in which a frame of one is missed, and one in which none of two is."""
    short, long = (
        replace(SCHEDULE, keys={**SCHEDULE.keys, "robot/camera/stereo": times})
        for times in ([0.0, 5.0], [0.0, 0.5, 5.0])
    )
    runs = [a_run("linux", slam="di"), a_run("linux", slam="iii", story="hotel")]
    found = replace(evidence(*runs), schedules={"library": short, "hotel": long})
    assert row(detail_tables.onsets(found, HEAVY), "Linux default", "drive: slam")[2] == "66.7"


def test_accuracy_is_a_mean_over_blocks():
    cells = row(detail_tables.accuracies(SOME, HEAVY), "speech: commands heard", "Linux default")
    assert cells[2:] == ["75 [75, 75] %", "10"]


def test_what_was_heard_stands_where_no_goal_judges_it():
    runs = [
        a_run(name, load="light", accuracy={"talk: speech": ["commands heard", value, "%", 8, True]})
        for name, value in (("linux", 87.5), ("weights", 75.0))
    ]
    said = tables.heard(evidence(*runs, a_run("static", load="light")), "light", ["linux", "static", "weights"])
    assert said.endswith(": Linux default 87.5; context weights 75.0.\n")
    assert tables.heard(SOME, "light", ["linux"]) == ""


def test_in_the_accuracy_of_a_block_each_sign_counts_once():
    """One of the eight signs of a block was missed, and none of another block."""
    few, many = (["signs read", value, "%", count, True] for value, count in ((50.0, 2), (100.0, 6)))
    runs = [
        *(a_run("linux", accuracy={"signs": one}, story=name) for one, name in ((few, "hotel"), (many, "library"))),
        *(a_run("linux", accuracy={"signs": many}, story=name, block=1) for name in ("hotel", "library")),
    ]
    cells = row(detail_tables.accuracies(evidence(*runs), HEAVY), "signs: signs read", "Linux default")
    assert cells[2:] == ["93.8 [87.5, 100] %", "4"]


def test_poses_count_where_slam_trusts_them():
    text = detail_tables.accuracies(evidence(a_run("linux", trusted="1101111111")), HEAVY)
    assert row(text, "slam: poses that it trusts", "Linux default")[2] == "80.0 %"


def test_the_players_own_lateness_is_reported():
    cells = row(detail_tables.player(SOME, HEAVY), "Linux default")
    assert cells[1:] == ["0.1 ms", "0.1 ms", "10 %"]


def test_runs_after_different_measures_of_the_machine_are_counted_apart():
    run = changed(a_run("limits"), whole=500000, expected=900_000, pace={"speed": 1_000_000, "left": 1.0})
    slow = changed(run, expected=450_000)
    later = changed(slow, whole=510000, date="2026-11-29T03:00:00+00:00")
    measures = detail_tables.measures(evidence(run, replace(slow, block=1), replace(later, block=2)))
    assert row(measures, "2026-11-26")[1:] == ["500000", "0.68 (0.45 to 0.90)", "2"]
    assert row(measures, "2026-11-29")[1:] == ["510000", "0.45 (0.45 to 0.45)", "1"]
    assert detail_tables.measures(evidence()) == ""


def test_speed_that_no_limit_follows_from_does_not_hide_how_far_off_it_was():
    run = changed(a_run("weights"), whole=500000, expected=900_000, pace={"speed": 1_000_000, "left": 1.0})
    assert detail_tables.measures(evidence(run)) == ""


def test_a_run_that_lasts_longer_since_its_queues_empty_slowly_does_not_use_more_cores():
    used = {"slam": [*range(0, 2001, 200), *[2100] * 20]}
    longer = evidence(a_run("linux", used=used))
    assert row(tables.of_load(longer, HEAVY), "Linux default")[-3] == "51"


def test_a_run_that_was_given_up_is_named():
    said = doubts.doubts(evidence(given_up(a_run("linux"))))
    assert said.startswith("- library, heavy load, Linux default, block 1: inputs")
    assert doubts.doubts(SOME) == ""


def test_a_run_in_which_a_decision_had_no_effect_counts_and_is_named():
    run = a_run("weights-gated")
    said = doubts.doubts(evidence(replace(run, about={**run.about, "violations": ["no plan had drive"]})))
    assert said.endswith("context weights, gated, block 1: counted as it was, though no plan had drive.\n")


def test_a_block_of_several_codes_machines_or_days_is_named():
    other = {**a_run("linux").about["machine"], "kernel": "7"}
    late = changed(a_run("weights"), code="def5678", machine=other, date="2026-11-28T03:00:00+00:00")
    said = doubts.doubts(evidence(a_run("linux"), late))
    assert said.startswith("- heavy load, block 1: its runs are not all alike: code abc1234, def5678; kernel 6, 7; ")
    assert "2026-11-26 03:00 to 2026-11-28 03:00" in said
    assert doubts.doubts(evidence(a_run("linux"), changed(a_run("weights", block=1), code="x"))) == ""


def test_a_run_that_had_to_be_begun_again_is_named():
    said = doubts.doubts(evidence(changed(a_run("linux"), failures=["DeployError: helm: timed\nout"])))
    assert said == "- library, heavy load, Linux default, block 1: begun 2 times: DeployError: helm: timed out.\n"


def test_attempts_before_a_run_was_played_again_are_named_as_well():
    """It knows only of those in the same call; what was set aside earlier is kept beside it."""
    own, earlier, other = "RejectedError: late", "98 % of their pace", "of another block"
    kept = [changed(a_run("linux"), failures=[reason]) for reason in ("late", earlier)]
    kept.append(changed(a_run("linux", block=1), failures=[other]))
    found = replace(evidence(changed(a_run("linux"), failures=[own])), rejected=kept)
    assert doubts.doubts(found) == (
        f"- library, heavy load, Linux default, block 1: begun 3 times: {own}; {earlier}.\n"
    )


def test_a_run_whose_work_turns_out_to_be_off_is_named():
    """The first ones are judged by none: when the campaign has ended they are judged by all."""
    off = [a_run("weights", block=0, cpu=0.015), *(a_run("weights", block=n, cpu=0.02) for n in range(1, 9))]
    said = doubts.doubts(evidence(a_run("alone"), *off))
    assert said == (
        "- library, heavy load, context weights, block 1: counted as it was, though the same inputs took 75% of other"
        " runs' work: expected 88% to 112%.\n"
    )


def test_attempts_that_do_not_count_are_shown_beside_those_that_do():
    """Whoever doubts the rule can see whether it favours a configuration."""
    attempt = changed(a_run("linux", slam="iiiid" + "iiiii"), failures=["the player was late"])
    found = replace(evidence(a_run("linux")), rejected=[attempt])
    name = "library, heavy load, Linux default, block 1"
    assert row(doubts.rejected(found), name) == [name, "the player was late", "90.0", "100.0"]
    assert doubts.rejected(SOME) == ""


def test_the_first_attempt_at_a_run_can_stand_for_the_one_that_counts():
    attempts = [changed(a_run("linux", slam=slam), date=date) for slam, date in (("d" * 10, "2"), ("l" * 10, "1"))]
    found = replace(evidence(a_run("linux"), a_run("linux", block=1)), rejected=[*attempts, a_run("weights")])
    first = doubts.as_first_played(found)
    [cell] = first.runs.values()
    assert cell[0] is attempts[1]
    assert cell[1] is found.runs["heavy", "library", "linux"][1]


def test_the_first_heavy_block_can_be_left_out():
    """Measures were changed after it; each task was played alone later, and nothing under light load before."""
    some = evidence(
        *(a_run(name, block=n) for name in ("alone", "linux") for n in (0, 1)), a_run("linux", load="light")
    )
    left = doubts.without_first_block(some).runs
    assert {cell: list(own) for cell, own in left.items()} == {
        ("heavy", "library", "alone"): [0, 1],
        ("heavy", "library", "linux"): [1],
        ("light", "library", "linux"): [0],
    }


def test_predictions_are_scored_against_simple_answers():
    frozen = {"predicted": {"misses": {"library": {"weights-gated": {"slam": 0.1, "speech": 0.0}}}}}
    text = detail_tables.predictions(evidence(*some_runs(), frozen=frozen))
    assert row(text, "library", "context weights, gated", "slam")[3:] == ["10.0", "0.0", "40.0"]
    assert row(text, "of all") == ["of all", "5.0", "0.0", "20.0"]
    worst = row(text, "context weights, gated, where over 5 % are missed, here or there")
    assert worst[1:] == ["10.0", "0.0", "40.0"]


@pytest.mark.parametrize(
    ("value", "text"),
    [(0, "0"), (0.00012, "0"), (1.426, "1.43"), (15.04, "15"), (12345.6, "12346"), (-0.5, "-0.5"), (100, "100")],
)
def test_figures_are_short(value, text):
    assert tables.short(value) == text
