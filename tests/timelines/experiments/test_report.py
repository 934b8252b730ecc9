"""The report of runs whose every figure is known; what is committed is what the data gives."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imsave

from tests.timelines.experiments.made_up import FROZEN, SCHEDULE, a_run, changed, evidence, some_runs
from timelines.experiments.__main__ import DATA, main
from timelines.experiments.evidence import BLOCKS, ENDING, Absent, Evidence, write_schedule
from timelines.experiments.record import block
from timelines.experiments.report import write_report


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    write_report(evidence(*some_runs(), frozen=FROZEN), folder)
    return folder


@pytest.fixture(scope="module")
def text(out):
    return (out / "report.md").read_text(encoding="utf-8")


def words(text):
    """What takes room on a page: bars of tables don't, and an interval takes that of a word."""
    whole = re.sub(r"\[[-+.\d]+, [-+.\d]+\]", "interval", text)
    return sum(any(letter.isalnum() for letter in word) for word in whole.split())


def test_the_claim_comes_first_and_fits_two_pages(text):
    assert text.index("of 10 goals are met") < text.index("## Heavy load")
    assert words(text) < 1400


def test_a_goal_that_ten_blocks_agree_on_is_met(text):
    rows = [line for line in text.splitlines() if line.startswith("| heavy")]
    [row] = [line for line in rows if "solo hit rate, less 2 points (gated)" in line]
    assert row.rstrip().endswith("| met |")


def test_report_lists_other_divisions_that_reach_the_goal(text):
    assert "- gated: context weights, gated.\n" in text


def test_of_too_few_blocks_it_does_not_say_that_none_reaches_a_goal(tmp_path):
    """Four that agree have a probability of 1/16."""
    for count, said in ((4, "not measured, or in too few blocks"), (5, "context weights, gated")):
        runs = [a_run("weights-gated", block=block) for block in range(count)]
        text = write_report(evidence(*runs, a_run("alone")), tmp_path).read_text(encoding="utf-8")
        assert f"- gated: {said}.\n" in text


def test_what_is_gained_and_who_pays_come_before_the_goals(tmp_path):
    schedule = replace(SCHEDULE, windows=[SCHEDULE.windows[0], SCHEDULE.windows[1]._replace(contexts=("read",))])
    signs = dict.fromkeys(("signs", "signs-left"), schedule.inputs["speech"])
    tasks = replace(schedule, inputs={**schedule.inputs, **signs})
    runs = [with_signs(a_run(name, slam=slam)) for name, slam in (("linux", "d" * 10), ("static", "i" * 10))]
    found = evidence(*runs, with_signs(a_run("weights", slam="i" * 6 + "d" * 4)))
    text = write_report(replace(found, schedules={"library": tasks}), tmp_path).read_text(encoding="utf-8")
    assert "**context weights did 100.0 and 100.0 % of SLAM's frames" in text
    assert "Linux default 0.0 and 100.0 %" in text
    assert (
        "of all frames and pictures to the right context weights did 60.0 and 100.0 %, static weights 100.0 and" in text
    )
    assert "of those to the left, which never matter most, 100.0 and 100.0 %" in text


def with_signs(run):
    signs = dict.fromkeys(("signs", "signs-left"), run.columns["speech"])
    return replace(run, columns={**run.columns, **signs}, plans=[])


def test_where_attempts_do_not_count_the_details_show_what_the_first_ones_say(tmp_path):
    attempt = changed(a_run("linux", slam="d" * 10), failures=["late"])
    found = evidence(a_run("linux"))
    for rejected, shown in (([attempt], True), ([], False)):
        write_report(replace(found, rejected=rejected), tmp_path)
        details = (tmp_path / "details.md").read_text(encoding="utf-8")
        assert ("## If each run's first attempt counted" in details) is shown


def test_first_attempts_are_shown_at_all_loads(tmp_path):
    """Where few blocks were played a repeated run weighs most."""
    runs = [a_run("linux", load=load, story=story) for load, story in (("heavy", "library"), ("1.1", "library"))]
    late = changed(a_run("linux", load="1.1", slam="iiidd" + "iiiii"), failures=["late"])
    soon = changed(a_run("weights-gated", load="paper", story="exp1"), finished=5.25)
    paper = [a_run(name, load="paper", story="exp1") for name in ("linux", "weights-gated")]
    write_report(replace(evidence(*runs, *paper), rejected=[late, soon]), tmp_path)
    [_, first] = (tmp_path / "details.md").read_text(encoding="utf-8").split("## If each run's first attempt counted")
    assert "| Linux default | 60.0 | 100.0 |" in first
    assert "| exp1 | context weights, gated | 2.00 |" in first


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--blocks", "0"], "invalid value '0': expected a whole number of at least 1"),
        (["--blocks", "-1"], "invalid value '-1': expected a whole number of at least 1"),
        (["--blocks", "many"], "invalid value 'many': expected a whole number of at least 1"),
    ],
)
def test_there_is_no_set_of_no_blocks(arguments, said, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(arguments)
    assert said in capsys.readouterr().err


def test_without_a_choice_everything_is_reported(tmp_path):
    blocks = tmp_path / BLOCKS
    blocks.mkdir()
    (blocks / f"2-heavy-01{ENDING}").write_bytes(block([a_run("linux"), a_run("weights")]))
    write_schedule(tmp_path, "library", SCHEDULE)
    assert main(["--report-only", "--data", str(tmp_path), "--report", str(tmp_path / "out")]) == 0
    assert "| context weights | 1 |" in (tmp_path / "out" / "report.md").read_text(encoding="utf-8")


def test_a_report_of_a_folder_without_runs_is_refused(tmp_path, capsys):
    assert main(["--report-only", "--data", str(tmp_path / "misspelt")]) == 1
    assert "misspelt: no runs: expected blocks" in capsys.readouterr().out.replace("\n", "")


def test_the_details_have_the_goals_without_the_first_heavy_block(out):
    details = (out / "details.md").read_text(encoding="utf-8")
    [_, rest] = details.split("## Without the first heavy block")
    assert "| light | first law" in rest.split("\n## ")[0]


def test_it_says_which_code_was_run(text, tmp_path):
    assert "Code: commit abc1234." in text
    other = a_run("weights")
    runs = [a_run("linux"), replace(other, about={**other.about, "code": "def5678 and changes"})]
    mixed = write_report(evidence(*runs), tmp_path).read_text(encoding="utf-8")
    assert "Code: [2 commits](details.md#which-code-was-run)." in mixed
    details = (tmp_path / "details.md").read_text(encoding="utf-8")
    assert "| heavy | abc1234 | 1 |\n| heavy | def5678 and changes | 1 |\n" in details


def test_it_says_how_much_the_tasks_want_of_what_there_is(text):
    assert "want: heavy load 1.21 times 1 x 0.8 processors ([at" in text  # nothing was run under any other


def test_the_details_have_how_slow_it_was(out):
    details = (out / "details.md").read_text(encoding="utf-8")
    assert "pace that each has: heavy load 1 x 0.8 (measured: 0.784).\n" in details


def test_the_details_have_what_was_calibrated(out):
    details = (out / "details.md").read_text(encoding="utf-8")
    assert "| slam | 0.25 | 100 ms | 100.0 % | 120 (143m) | 16 (500m) |" in details
    assert "drive 0.31" in details


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


def test_decisions_are_drawn_where_they_are_carried_out(out):
    """A dry run's shares are nobody's."""
    names = {path.name for path in (out / "figures").iterdir()}
    assert "decided-weights-gated.svg" in names
    assert {"decided-linux-gated.svg", "decided-static-gated.svg"}.isdisjoint(names)


def test_pictures_have_whole_lines_with_their_names_beside_them(out):
    drawn = {path.name: path.read_text(encoding="utf-8") for path in (out / "figures").iterdir()}
    assert [name for name, text in drawn.items() if "dasharray" in text or "legend" in text] == []
    assert ">context weights, gated</text>" in drawn["responses.svg"]
    assert ">drive: slam</text>" in drawn["factors-heavy.svg"]


def test_each_set_of_static_weights_is_a_point_where_one_task_is_drawn_against_another(tmp_path):
    """The committed ones: of every set the story that all ran."""
    searched = {name: Evidence.read(DATA).searched[name] for name in ("ungated", "gated")}
    write_report(replace(evidence(*some_runs()), searched=searched), tmp_path)
    assert "(figures/static.svg)" in (tmp_path / "details.md").read_text(encoding="utf-8")
    drawn = (tmp_path / "figures" / "static.svg").read_text(encoding="utf-8")
    marks = drawn.count("<use ") - drawn.count('<g id="xtick') - drawn.count('<g id="ytick')
    assert marks == sum(run.record.story == "errand" for runs in searched.values() for run in runs)


def test_what_the_camera_saw_is_drawn_below_the_contexts(tmp_path):
    frames = tmp_path / "library.png"
    imsave(frames, np.zeros((8, 40)))
    write_report(replace(evidence(a_run("linux")), films={"library": frames}), tmp_path)
    assert "(figures/film.svg)" in (tmp_path / "details.md").read_text(encoding="utf-8")
    drawn = (tmp_path / "figures" / "film.svg").read_text(encoding="utf-8")
    assert "<image " in drawn
    assert ">drive</text>" in drawn


def test_realtime_is_drawn_and_takes_no_part_in_tables(tmp_path):
    runs = [a_run("linux"), a_run("realtime", load="unslowed", story="exp2")]
    text = write_report(evidence(*runs), tmp_path).read_text(encoding="utf-8")
    assert "context realtime" not in text
    details = (tmp_path / "details.md").read_text(encoding="utf-8")
    assert all(f"(figures/{what}-realtime.svg)" in details for what in ("used", "decided"))
    assert "| context realtime" not in details


def test_a_quick_look_says_that_nothing_was_calibrated(tmp_path):
    path = write_report(evidence(a_run("linux")), tmp_path)
    assert "a quick look" in path.read_text(encoding="utf-8")


def test_a_quick_look_at_a_story_of_the_paper_has_hit_rates_and_what_was_not_run(tmp_path):
    runs = [a_run(name, load="paper", story="exp3") for name in ("linux", "limits-gated")]
    absent = [Absent("paper", "exp3", "weights-gated", 0, "helm: timed out")]
    text = write_report(evidence(*runs, absent=absent), tmp_path).read_text(encoding="utf-8")
    assert "- context weights, gated, paper load, 1 run: not run: helm: timed out.\n" in text
    assert "paper load: 1 x 0.4" in text
    details = (tmp_path / "details.md").read_text(encoding="utf-8")
    assert "| context limits, gated | 1 | 100.0 | 100.0 |" in details[details.index("## Paper load") :]


def test_the_committed_report_is_what_the_committed_data_gives(tmp_path):
    path = write_report(Evidence.read(DATA), tmp_path)
    assert words(path.read_text(encoding="utf-8")) < 1400
    for name in ("report.md", "details.md"):
        assert (tmp_path / name).read_text(encoding="utf-8") == (DATA.parent / name).read_text(encoding="utf-8")
