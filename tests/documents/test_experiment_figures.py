"""What the pages say of the experiments is what the committed report has, which is computed from the committed data."""

from __future__ import annotations

import re
from collections import defaultdict
from statistics import fmean, median

import pytest

from tests.documents.experiment_pages import DATA, DETAILS, PAGE, PREDICTION, README, REPORT
from timelines.experiments.accounting import Ending
from timelines.experiments.configurations import CONFIGURATIONS, LINUX, PAPERS, VARIANTS, WEIGHTS_AT_ONCE
from timelines.experiments.evidence import Evidence, read_schedule
from timelines.experiments.metrics import Run
from timelines.experiments.rates import work_of_same, worst_context
from timelines.experiments.record import records
from timelines.experiments.stories import PAPER, STORIES
from timelines.experiments.tables import WORK, runs_of

ROWS = ("Linux default", "static weights", "context weights", "context limits")
"""Rows of the README and of the page, as the report calls them."""


def table(head):
    """The first table of the report with such a column: cells by row and column, without intervals."""
    lines = REPORT.splitlines()
    begin = next(number for number, line in enumerate(lines) if line.startswith("|") and f"| {head} |" in line)
    columns, _, *rows = (
        [cell.partition(" [")[0].strip() for cell in line.split("|")[1:-1]]
        for line in lines[begin : lines.index("", begin)]
    )
    return {row[0]: dict(zip(columns, row, strict=True)) for row in rows}


@pytest.fixture(scope="module")
def heavy():
    return table("drive: slam")


@pytest.fixture(scope="module")
def costs():
    return table("signs-left")


def test_blocks_are_counted(heavy):
    counted = {heavy[row]["blocks"] for row in ROWS}
    assert [{count} for count in re.findall(r"(\d+) randomised blocks?", README)] == [counted]
    assert [{count} for count in re.findall(r"(\d+) blocks? of two held-out stories", PAGE)] == [counted]


@pytest.mark.parametrize("page", [README, PAGE], ids=["README", "page"])
@pytest.mark.parametrize("row", ROWS)
def test_what_contexts_gain_and_cost(row, page, heavy, costs):
    own, all_ = heavy[row], costs[row]
    cells = [
        *(own[column] for column in ("drive: slam", "read: signs")),
        *(all_[column] for column in ("slam", "signs", "signs-left", "signs read while reading, %", "signs read, %")),
        all_["of the tasks' CPU used, %"],
    ]
    assert f"| {row} | {' | '.join(cells)} |" in page


def details_rows(section):
    """The first row of each name in a section of the details, as cells without intervals."""
    lines = DETAILS[DETAILS.index(f"\n## {section}\n") :].splitlines()
    split = ([cell.partition(" [")[0].strip() for cell in line.split("|")[1:-1]] for line in lines if line[:1] == "|")
    found: dict[str, list[list[str]]] = {}
    for cells in split:
        found.setdefault(cells[0], []).append(cells)
    return found


@pytest.mark.parametrize("row", [CONFIGURATIONS[one.name].title for one in VARIANTS])
def test_what_variants_do_in_time(row):
    hits, done, *_ = details_rows("Heavy load")[row]
    cells = [hits[4], hits[2], *done[1:4], hits[8]]
    assert f"| {row} | {' | '.join(cells)} |" in PAGE


@pytest.mark.parametrize("row", [*ROWS, WORK])
def test_from_which_load_on_contexts_help(row):
    assert f"| {row} | {' | '.join(list(table('1.25')[row].values())[1:])} |" in PAGE


@pytest.mark.parametrize("row", [CONFIGURATIONS[one.name].title for one in PAPERS if one is not LINUX])
def test_the_papers_total_times(row):
    assert f"| {row} | {' | '.join(list(table('exp1')[row].values())[1:])} |" in PAGE


def test_how_much_sooner_the_papers_stories_could_end_at_all():
    """None ends before its last input comes."""
    took = defaultdict(list)
    paths = sorted((DATA / "blocks").glob("7-paper-*.json.xz"))
    for one in (one for path in paths for one in records(path.read_bytes())):
        if one.configuration == LINUX.name:
            took[one.story].append(one.about["finished"] / STORIES[one.story].seconds)
    most = ", ".join(f"{fmean(took[story.name]):.2f} ({story.name})" for story in PAPER)
    assert f"at most {most}" in PAGE
    assert f"exp1 to exp3, {len(paths)} block" in PAGE


def test_how_much_blocks_of_the_papers_stories_differ():
    done: defaultdict[int, list[bool]] = defaultdict(list)
    for path in sorted((DATA / "blocks").glob("7-paper-*.json.xz")):
        for one in (one for one in records(path.read_bytes()) if one.configuration == LINUX.name):
            run = Run(read_schedule(DATA / "schedules" / f"{one.story}.json.xz"), one)
            done[one.block] += [end.ending is Ending.IN_TIME for end in run.wanted("slam", "moving")]
    first, second, third = (f"{100 * fmean(own):.1f}" for own in done.values())
    assert f"Block by block Linux' default did {first}, {second} and {third} %" in PAGE


def test_which_runs_of_the_papers_stories_were_played_again_for_their_speed():
    again = {
        (one.story, one.configuration, one.block)
        for path in (DATA / "rejected").glob("7-paper-*.json.xz")
        for one in records(path.read_bytes())
        if "as fast as the limits counted on" in one.about["failures"][0]
    }
    under = limited("blocks/7-paper-*.json.xz")
    assert f"Of the {len(under)} runs under limits {len(again)} were played again" in PAGE


def test_first_attempts_at_the_papers_stories():
    first = DETAILS[DETAILS.index("## If each run's first attempt counted") :]
    times = dict(re.findall(r"\| (exp\d \| context [^|]+) \| ([\d.]+) \[", first))
    exp2, exp3 = (times[f"{story} | context weights, gated"] for story in ("exp2", "exp3"))
    limits, resized = (times[f"exp2 | context limits{how}, gated"] for how in ("", " by resize"))
    assert f"exp2 ends {exp2} times as soon under context weights" in PAGE
    assert f"exp3 {exp3} times, with a block at {re.findall(exp3 + r' .([0-9.]+),', first)[0]}" in PAGE
    assert f"in exp2 ({limits}, by resize {resized})" in PAGE
    hits = dict(re.findall(r"\| (context [^|]+) \| 3 \| ([\d.]+) \[", first[first.index("Paper load") :]))
    assert f"context limits had {hits['context limits, gated']} % in time" in PAGE


def test_what_limits_by_resize_do_on_the_papers_stories():
    hits = details_rows("Paper load")["context limits by resize, gated"][0]
    assert f"With limits by resize {hits[2]} % were in time" in PAGE
    assert f"the IMU, which is protected, kept {hits[4]} %" in PAGE


def test_how_far_off_slam_is_with_modules_that_adapt():
    text = DETAILS[DETAILS.index("\n## Heavy load\n") :]
    off = dict(reversed(re.findall(r"\| slam: ATE \| ([^|]+) \| ([\d.]+) \[", text)))
    plain, weights = (1000 * float(off[f"{one}, gated, adaptive"]) for one in ("Linux default", "context weights"))
    assert f"SLAM is off by\n  {plain:.0f} mm under Linux' default, by {weights:.0f} under context weights" in PAGE


def work(runs, others):
    """For the same inputs, as a part of the others'."""
    part = work_of_same(runs, others)
    assert part is not None
    return part


def test_at_the_largest_load_runs_differ():
    """By work for the same inputs, each division against itself at the heavy load."""
    evidence = Evidence.read(DATA)
    parts = []
    for name in ("linux", "static", "weights"):
        heavy = runs_of(evidence, "heavy", [name])[name]
        parts += [work([run], heavy) for run in runs_of(evidence, "1.6", [name])[name]]
    assert f"range from {1.6 * min(parts):.2f} to {1.6 * max(parts):.2f} by that measure" in PAGE
    for name in ("linux", "static"):
        every = runs_of(evidence, "1.6", [name])[name]
        found = [worst_context([run for run in every if run.record.block == block]) for block in range(3)]
        rates = [one.mean for one in found if one]
        assert max(rates) == rates[0]


def test_what_was_repeated_at_the_largest_load_for_its_work():
    evidence = Evidence.read(DATA)
    rejected = [one for one in evidence.rejected if one.load == "1.6" and "the same inputs" in one.about["failures"][0]]
    assert {one.configuration for one in rejected} == {LINUX.name}
    heavy = runs_of(evidence, "heavy", [LINUX.name])[LINUX.name]
    attempts = [work([Run(evidence.schedules[one.story], one)], heavy) for one in rejected]
    least, most = (f"{100 * part:.0f}" for part in (min(attempts), max(attempts)))
    assert f"{ {5: 'five'}[len(attempts)] } attempts\nunder Linux' default" in PAGE
    assert f"took {least} to {most} % of the work at 1.4" in PAGE


def test_how_much_less_work_the_variants_were():
    evidence = Evidence.read(DATA)
    at_once, settled = (runs_of(evidence, "heavy", [name])[name] for name in (WEIGHTS_AT_ONCE.name, "weights-gated"))
    assert (
        f"The same inputs took {100 * (1 - work(at_once, settled)):.0f} % less work there than in the ten blocks"
        in PAGE
    )


def test_what_limits_lose_is_mostly_at_the_onset_of_contexts():
    said = []
    for section in ("Heavy load", "1.6 load"):
        lines = DETAILS[DETAILS.index(f"\n## {section}\n") :]
        said += re.findall(r"\| context limits \| drive: slam \| ([\d.]+) \| ([\d.]+) \|", lines)[:1]
    (early, later), at_more = said
    assert f"they keep {early} % in it at 1.4, and {later} % after it" in PAGE
    assert f"{at_more[0]} and {at_more[1]} %" in PAGE


def test_what_the_papers_stories_do_in_time():
    rows = {name: own[0] for name, own in details_rows("Paper load").items()}
    slam = [rows[name][2] for name in ("Linux default", "Linux default, gated")]
    weights, limits = (rows[f"context {name}, gated"] for name in ("weights", "limits"))
    said = f"Linux' default does {slam[0]} %, {slam[1]} % with the same tasks suspended, context weights {weights[2]} %"
    assert f"{said}, context limits {limits[2]} %" in PAGE
    resized = rows["context limits by resize, gated"]
    assert f"the tasks use {limits[5]} % (by resize {resized[5]} %) of what they could have" in PAGE


def limited(pattern):
    """How fast processors were in runs under limits, as a part of what those counted on, less one."""
    runs = [one for path in sorted(DATA.glob(pattern)) for one in records(path.read_bytes())]
    under = [one.about for one in runs if CONFIGURATIONS[one.configuration].control == "Limit"]
    return [about["pace"]["speed"] / about["expected"] - 1 for about in under]


def test_how_far_off_the_speed_was_that_limits_counted_on():
    before = limited("blocks/[2-5]-*.json.xz")
    assert f"all {len(before)} runs under limits before were within it" in PAGE
    assert f"the farthest off by {100 * max(map(abs, before)):.0f} %" in PAGE


def test_what_context_weights_cost_and_leave_at_a_smaller_load():
    done: defaultdict[tuple[str, str], list[bool]] = defaultdict(list)
    for path in sorted((DATA / "blocks").glob("4-1.1-*.json.xz")):
        for one in records(path.read_bytes()):
            run = Run(read_schedule(DATA / "schedules" / f"{one.story}.json.xz"), one)
            for task in ("slam", "signs-left"):
                done[one.configuration, task] += [end.ending is Ending.IN_TIME for end in run.ended(task)]
    weights, static = (
        {task: 100 * fmean(done[name, task]) for task in ("slam", "signs-left")} for name in ("weights", "static")
    )
    assert f"{static['slam']:.1f}" == "100.0"
    assert f"did {weights['slam']:.0f} % (of the pictures to the left {static['signs-left']:.0f} %, context" in PAGE
    assert f"weights {weights['signs-left']:.0f})" in PAGE


def unanswered(pattern):
    """The control of each run of which an attempt is not kept, since a task gave no answer in the end."""
    every = (one for path in sorted(DATA.glob(pattern)) for one in records(path.read_bytes()))
    return [
        CONFIGURATIONS[one.configuration].control
        for one in every
        for failure in one.about["failures"]
        if "no answer" in failure
    ]


def test_what_was_kept_of_no_attempt():
    assert unanswered("blocks/2-heavy-*.json.xz") == 4 * ["Limit"]
    assert "that happened four times in the heavy blocks, each time under limits" in PAGE
    assert unanswered("blocks/7-paper-*.json.xz") == 3 * ["Limit"]
    assert "On the paper's stories it happened three times even so, again under limits" in PAGE


def test_how_late_the_player_was_under_heavy_load():
    late = defaultdict(list)
    for path in sorted((DATA / "blocks").glob("2-heavy-*.json.xz")):
        for one in records(path.read_bytes()):
            samples = sorted(one.late["robot/imu/raw"])
            late[one.configuration].append(samples[int(0.99 * len(samples))] / 10)
    last = {name: median(own) for name, own in late.items()}
    resized = last.pop("limits-resized")
    assert f"late by {min(last.values()):.0f} to {max(last.values()):.0f} ms there, and by {resized:.0f} under" in PAGE


def test_predictions_are_scored_as_in_the_details():
    found = r"\| (of all|[^|]*, where over 5 % are missed[^|]*) \|.*"
    scores = [line for line in DETAILS.splitlines() if re.fullmatch(found, line)]
    assert len(scores) == 5
    assert all(line in PREDICTION for line in scores)
