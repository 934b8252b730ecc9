"""The report of runs whose every figure is known; what is committed is what the data gives."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.timelines.experiments.made_up import a_run, evidence
from timelines.experiments import tables
from timelines.experiments.__main__ import DATA
from timelines.experiments.blocks import HEAVY
from timelines.experiments.evidence import Evidence
from timelines.experiments.report import write_report

FROZEN = {"loads": {"light": [2, 0.8], "heavy": [1, 0.8]}, "solo": {"slam": 1.0}, "deadlines": {"slam": 0.1}}
ACCURACY = {"slam": ["ATE", 0.02, "m", 90, False], "speech": ["commands heard", 75.0, "%", 4, True]}


def some_runs():
    for block in range(10):
        yield a_run("linux", slam="i" * 3 + "d" * 7, block=block, accuracy=ACCURACY)
        yield a_run("linux-gated", slam="i" * 3 + "dd" + "sssss", block=block, accuracy=ACCURACY)
        yield a_run("weights-gated", slam="i" * 5 + "sssss", block=block, accuracy=ACCURACY)
        yield a_run("static-gated", slam="ii" + "ddd" + "sssss", block=block, accuracy=ACCURACY)
    yield a_run("alone")
    for block in range(3):
        for name, finished in (("linux", 30.0), ("limits-gated", 20.0)):
            run = a_run(name, block=block, load="paper", story="exp1")
            yield replace(run, about={**run.about, "finished": finished})


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    write_report(evidence(*some_runs(), frozen=FROZEN), folder)
    return folder


@pytest.fixture(scope="module")
def text(out):
    return (out / "report.md").read_text(encoding="utf-8")


def test_the_claim_comes_first_and_fits_two_pages(text):
    assert text.index("goals that were measured are met") < text.index("## Heavy load")
    assert len(text.split()) < 1500


def test_each_configuration_has_its_hit_rates_by_context(text):
    [row] = [line for line in text.splitlines() if line.startswith("| Linux default | 10 |")]
    cells = [cell.strip() for cell in row.split("|")]
    assert cells[2:5] == ["10", "60.0", "100.0"]


def test_a_goal_that_ten_blocks_agree_on_is_met(text):
    rows = [line for line in text.splitlines() if line.startswith("| heavy")]
    [row] = [line for line in rows if "as alone, less 2 points (gated)" in line]
    assert row.rstrip().endswith("| met |")


def test_it_says_which_divisions_reach_it_too(text):
    assert "less 2 points (gated): context weights, gated.\n" in text


def test_the_papers_measure_stands_beside_its_own_figure(text):
    assert "| exp1 | context limits, gated | 1.50 [1.50, 1.50] | 3 |" in text
    assert "up to 1.42" in text


def test_wheel_commands_are_reported_from_camera_and_word(text):
    assert "| Linux default | 60.0 % | 60 ms | 60 ms | 10 of 10 | 800 ms |" in text


def test_the_details_have_every_ending_and_the_onsets(out):
    details = (out / "details.md").read_text(encoding="utf-8")
    assert "| slam | context weights, gated | 10 | 50.0 | 0.0 | 0.0 | 50.0 | 0.0 | 100.0 |" in details
    assert "first second" in details


def test_pictures_are_there_and_the_same_data_gives_the_same_ones(out, text, tmp_path):
    write_report(evidence(*some_runs(), frozen=FROZEN), tmp_path)
    pages = text + (out / "details.md").read_text(encoding="utf-8")
    names = {line.partition("(figures/")[2].rstrip(")") for line in pages.splitlines() if line.startswith("![")}
    assert names == {path.name for path in (out / "figures").iterdir()}
    for name in names:
        assert (out / "figures" / name).read_bytes() == (tmp_path / "figures" / name).read_bytes()


def test_predictions_are_scored_against_simple_answers():
    frozen = {"predicted": {"misses": {"delivery": {"weights-gated": {"slam": 0.1, "speech": 0.0}}}}}
    text = tables.predictions(evidence(*some_runs(), frozen=frozen))
    assert "| delivery | context weights, gated | slam | 10.0 | 0.0 | 40.0 |" in text
    assert text.rstrip().endswith("| 5.0 | 0.0 | 20.0 |")


def test_a_quick_look_says_that_nothing_was_calibrated(tmp_path):
    path = write_report(evidence(a_run("linux")), tmp_path)
    assert "a quick look" in path.read_text(encoding="utf-8")


def test_without_runs_of_a_load_there_is_no_table():
    assert tables.of_load(evidence(a_run("linux", load="light")), HEAVY) == ""


@pytest.mark.skipif(not (DATA / "blocks").is_dir(), reason="no block has been measured yet")
def test_the_committed_report_is_what_the_committed_data_gives(tmp_path):
    write_report(Evidence.read(DATA), tmp_path)
    for name in ("report.md", "details.md"):
        assert (tmp_path / name).read_text(encoding="utf-8") == (DATA.parent / name).read_text(encoding="utf-8")
