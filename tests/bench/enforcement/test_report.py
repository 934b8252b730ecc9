"""Report and picture show what was measured, and no more."""

import pytest

from tests.bench.enforcement.data import values
from tests.bench.enforcement.divisions import ALONE, DEFAULT, PRIORITY, TUNED, WEIGHTS
from tests.bench.enforcement.figures import Run
from tests.bench.enforcement.goals import FEWEST, verdicts
from tests.bench.enforcement.inputs import Queue
from tests.bench.enforcement.journal import Journal
from tests.bench.enforcement.matrix import Cell, cells
from tests.bench.enforcement.picture import draw
from tests.bench.enforcement.report import text
from tests.bench.enforcement.stories import IMPORTANCE, SUSPENDING, tasks

ABOUT = {"machine": "a machine", "seconds": 4.0, "blocks": 10}


@pytest.fixture
def journal(tmp_path):
    return Journal(tmp_path / "enforcement.jsonl", {}, resume=False)


def a_run(missed=0, foreign=0.0):
    responses = {
        task.name: {context.name: [None] * missed + [10] * (10 - missed) for context in IMPORTANCE.contexts}
        for task in tasks(1.3)
    }
    return Run(responses, {"slam": 3.0, "map": 5.0}, 0.5, foreign=foreign)


def a_cell(division, story=IMPORTANCE, *, gated=False):
    return Cell(story.name, 1.3, Queue.NEWEST, gated, division)


def judged(journal):
    return verdicts(journal.figures, 20)


def report(journal):
    return text(journal, *cells(), ABOUT, judged(journal))


def test_row_has_the_median_and_range_of_all_blocks(journal):
    journal.add(a_cell(DEFAULT), 0, a_run(missed=2))
    journal.add(a_cell(DEFAULT), 1, a_run(missed=4))
    assert "| default | 70.0 % (70, 60-80) |" in report(journal)
    assert "8.00 s" in report(journal)
    assert "slam 1.0 / never" in report(journal)


HEAVY = {DEFAULT: 5, ALONE: 0, WEIGHTS: 1}


def test_missed_goals_are_named_with_the_figure_and_its_margin(journal):
    for block in range(FEWEST):
        for division, missed in HEAVY.items():
            journal.add(a_cell(division), block, a_run(missed))
    found = report(journal)
    assert f"- heavy: importance, load 1.3, nothing suspended: context weights: **missed** ({FEWEST} blocks)" in found
    assert "  - missed: read: 90.0% of inputs hit, 100.0% alone; margin -7.00 (-7.00 to -7.00) points" in found
    assert "heavy: importance, load 1.6, nothing suspended: context weights: not measured" in found
    assert "first law: suspending, load 0.7, gated: context suspension: not measured" in found


def test_cells_that_were_measured_one_after_the_other_are_not_judged(journal):
    for division, missed in HEAVY.items():
        for block in range(FEWEST):
            journal.add(a_cell(division), block, a_run(missed))
    assert "nothing suspended: context weights: **not judged: its blocks are not interleaved**" in report(journal)


def test_a_report_is_the_same_when_it_is_written_again(journal, tmp_path):
    """Of the file alone, in which the order of the runs counts."""
    for block in range(FEWEST):
        for division, missed in HEAVY.items():
            journal.add(a_cell(division), block, a_run(missed))
    again = Journal(tmp_path / "enforcement.jsonl", {}, resume=True)
    assert report(again) == report(journal)
    assert values(again, ABOUT, judged(again)) == values(journal, ABOUT, judged(journal))


@pytest.mark.parametrize(("story", "gated"), [(IMPORTANCE, False), (SUSPENDING, True)])
def test_every_task_is_shown_at_light_load_with_the_range_of_its_blocks(journal, story, gated):
    for division in (DEFAULT, PRIORITY, WEIGHTS):
        cell = Cell(story.name, 0.7, Queue.NEWEST, gated, division)
        for block, missed in enumerate((0, 5)):
            journal.add(cell, block, a_run(missed))
    section = report(journal).split("## Load 0.7, every task")[1]
    rows = [line for line in section.splitlines() if line.startswith("|")][2:5]
    assert [row.split(" | ")[0] for row in rows] == ["| default", "| priority", "| context weights"]
    assert all(row.count("| 75.0 (50.0-100.0), never (1.0-never)") == len(tasks(0.7)) for row in rows)


def test_gating_section_compares_with_ungated_static_divisions(journal):
    journal.add(a_cell(DEFAULT), 0, a_run(missed=7))
    journal.add(a_cell(DEFAULT, SUSPENDING, gated=True), 0, a_run(missed=3))
    journal.add(a_cell(WEIGHTS, SUSPENDING, gated=True), 0, a_run())
    found = report(journal)
    same, on = found.split("## Contexts suspend, the same gating for all")[1].split("## Contexts suspend, gating on")
    assert "| default | 70.0 %" in same
    assert "| default | 30.0 %" in on
    assert "| context weights | 100.0 %" in same
    assert "| context weights | 100.0 %" in on


def test_disturbed_runs_are_counted(journal):
    journal.add(a_cell(DEFAULT), 0, a_run(foreign=0.2))
    journal.add(a_cell(DEFAULT), 1, a_run(foreign=0.3))
    assert "\n2 runs; " in report(journal)
    assert "In 1 of the runs others took more than\n0.02 of a core" in report(journal)


def test_the_planned_runs_that_are_left_are_counted_whatever_else_was_measured(journal):
    cell = a_cell(DEFAULT)
    about = {**ABOUT, "blocks": 2}
    for block in (0, 2, 3):
        journal.add(cell, block, a_run())
    assert "3 runs; 1 of the 2 planned are left." in text(journal, [cell], {}, about, [])
    journal.add(cell, 1, a_run())
    assert "4 runs; none of the planned are left." in text(journal, [cell], {}, about, [])


@pytest.mark.parametrize(
    ("story", "gated", "line"),
    [
        (IMPORTANCE, False, "the same of static divisions: not shown: default, priority, tuned; the best is priority"),
        (SUSPENDING, True, "load 1.3, equal gating: the best static is priority"),
    ],
)
def test_the_best_static_division_is_named_with_its_figures(journal, story, gated, line):
    for division, missed in ((DEFAULT, 6), (PRIORITY, 3), (TUNED, 5), (ALONE, 0), (WEIGHTS, 0)):
        journal.add(a_cell(division, story, gated=gated and division != ALONE), 0, a_run(missed))
    found = report(journal)
    assert f"{line} (drive 70.0 %, talk 70.0 %, read 70.0 %; runs: 1)" in found
    entries = [one for one in values(journal, ABOUT, [])["best static"] if one["division"]]
    assert entries == [
        {
            "story": story.name,
            "load": 1.3,
            "gated": gated,
            "division": PRIORITY,
            "critical": dict.fromkeys(("drive", "talk", "read"), 0.7),
        }
    ]


def test_every_reason_for_leaving_cells_out_is_there(journal):
    measured, left_out = cells()
    found = text(journal, measured, left_out, ABOUT, [])
    assert all(reason in found for reason in left_out.values())


def test_search_result_is_reported_with_its_trials(journal):
    trial = {"shares": {"slam": 900}, "simulated": 0.8, "runs": 2, "critical": {"drive": 0.75}}
    journal.add_tuned(a_cell(TUNED), {"slam": 900}, [trial])
    assert "slam 900: worst 80.0 % simulated; at worst in 2 runs: drive 75.0 %" in report(journal)


def test_plain_data_has_goals_and_cells(journal):
    journal.add(a_cell(DEFAULT), 0, a_run(missed=2))
    found = values(journal, ABOUT, judged(journal))
    assert {goal["outcome"] for goal in found["goals"]} == {"not measured"}
    (cell,) = found["cells"]
    assert cell["critical"]["drive"] == {"hit": 0.8, "blocks": [0.8]}
    assert (cell["tasks"]["imu"]["p99"], cell["tasks"]["imu"]["p99 blocks"]) == (None, [None]), "never"


def test_the_same_figures_give_the_same_picture(journal, tmp_path):
    journal.add(a_cell(DEFAULT), 0, a_run(missed=2))
    for name in ("one", "other"):
        draw(journal, tmp_path / f"{name}.svg")
    assert (tmp_path / "one.svg").read_bytes() == (tmp_path / "other.svg").read_bytes()
    assert "load 1.3, nothing suspended" in (tmp_path / "one.svg").read_text()


def test_no_picture_is_drawn_without_measurements(journal, tmp_path):
    draw(journal, tmp_path / "none.svg")
    assert not (tmp_path / "none.svg").exists()
