"""What the pages say of the paper's experiments is what the committed measurements give (timelines/results)."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from pathlib import Path
from statistics import fmean, median, stdev

import pytest

ROOT = Path(__file__).parents[2]
RUNS = json.loads((ROOT / "timelines" / "results" / "measures.json").read_text(encoding="utf-8"))
PAGE, SUMMARY, PAPER = (
    (ROOT / "docs" / name).read_text(encoding="utf-8")
    for name in ("measurements/paper-experiments.md", "measurements/README.md", "explanation/paper.md")
)
LINUX = "linux-default"
STORIES = ("exp1-x6", "exp2-x6", "exp3-x6")
STUDENT = 4.302653
"""The 97.5 % quantile of Student's t with the two degrees of freedom of three runs."""
ROWS = {
    "`scheduler: Realtime`, the node agent writes (RT CA), a period of 1 s": "rt-ca-1s",
    "the same, 100 ms, the default": "rt-ca-100ms",
    "`control: Weight`": "weight",
    "limits (CFS CA), the node agent writes": "cfs-ca-agent",
    "limits (CFS CA), resizes only": "cfs-ca",
    "limits by priority, set once": "static-limits",
    "VerticalPodAutoscaler in place": "vpa",
}


def runs(story, configuration):
    return {run["repeat"]: run for run in RUNS if (run["series"], run["configuration"]) == (story, configuration)}


def speedup(story, configuration):
    """The geometric mean of Linux default's total time divided by it, with its interval; empty without runs."""
    bases, own = runs(story, LINUX), runs(story, configuration)
    ratios = [math.log(bases[one]["total_time"] / own[one]["total_time"]) for one in sorted(own)]
    if not ratios:
        return []
    assert len(ratios) == 3
    around = STUDENT * stdev(ratios) / math.sqrt(3)
    return [math.exp(fmean(ratios) + shift) for shift in (0, -around, around)]


def cell(story, configuration):
    found = speedup(story, configuration)
    return " {:.2f} [{:.2f}, {:.2f}] ".format(*found) if found else " "


@pytest.mark.parametrize("row", ROWS)
def test_total_times(row):
    assert f"| {row} |{'|'.join(cell(story, ROWS[row]) for story in STORIES)}|" in PAGE


def span(*configurations):
    found = [speedup(story, one)[0] for one in configurations for story in STORIES if speedup(story, one)]
    return f"{min(found):.2f} to {max(found):.2f} times"


def test_summaries():
    limits, realtime = span("cfs-ca", "cfs-ca-agent"), span("rt-ca-1s", "rt-ca-100ms")
    assert f"limits {limits}; Realtime, which does better, {realtime} |" in SUMMARY
    resized, agent, second, default = map(span, ("cfs-ca", "cfs-ca-agent", "rt-ca-1s", "rt-ca-100ms"))
    said = " ".join(PAPER.split())
    assert f"measured {resized} for limits with resizes, {agent.partition(' to ')[0]} times with the agent" in said
    assert f"{second} with the paper's period of 1 s, {default.partition(' to ')[0]} times with our default" in said


def parts(configuration, ending):
    """The part of exp1's inputs that ended so, in percent: the median run."""
    return median(_part(run, ending) for run in runs("exp1-x6", configuration).values())


def _part(run, ending):
    counts: Counter[str] = Counter()
    for task in run["tasks"].values():
        counts.update(task["inputs"])
    return 100 * counts[ending] / counts.total()


def test_work_that_was_not_done():
    said = re.search(
        r"Linux' default lost ([\d.]+) % on the bus, limits ([\d.]+) % and Realtime ([\d.]+) %, and ([\d.]+) % and\s"
        r"([\d.]+) % were suspended",
        PAGE,
    )
    assert said
    lost = [parts(one, "lost") for one in (LINUX, "cfs-ca", "rt-ca-1s")]
    found = [*lost, *(parts(one, "suspended") for one in ("cfs-ca", "rt-ca-1s"))]
    assert [float(one) for one in said.groups()] == [round(one) for one in found]


def test_misses_at_real_pace():
    missed = {
        one: [run["tasks"]["slam"]["moving"]["missed"] for run in runs("exp3-x1", one).values()]
        for one in (LINUX, "cfs-ca", "rt-ca-1s")
    }
    due = sum(run["tasks"]["slam"]["moving"]["due"] for run in runs("exp3-x1", "cfs-ca").values())
    assert sum(missed[LINUX]) == sum(missed["rt-ca-1s"]) == 0
    assert f"under limits {sum(missed['cfs-ca'])} of {due}, " in PAGE
    assert "four of them at one start" in PAGE
    assert max(missed["cfs-ca"]) == 4


def test_what_is_quoted_of_the_report():
    """Figures of recordings that are not committed: the report has them."""
    report = (ROOT / "timelines" / "results" / "report.md").read_text(encoding="utf-8")
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in report.splitlines() if _is_time(line)]
    equal = [row[3].split()[0] for row in rows if row[0] in {"RT CA, 1 s", "CFS CA"}]
    assert f"Realtime is {equal[1]} times as fast, limits {equal[0]} times" in PAGE
    beside = {(story, row[0]): float(row[-1].split()[0]) for story, row in _by_story(rows)}
    linux, limits = beside[0, "Linux default"], beside[0, "CFS CA"]
    assert f"used {limits:.0f} s of it under limits instead of {linux:.0f} s" in " ".join(PAGE.split())
    second = f"on exp2 {beside[1, 'CFS CA']:.1f} s instead of {beside[1, 'Linux default']:.1f} s"
    assert second in " ".join(PAGE.split())
    assert f"{beside[1, 'CFS CA, agent']:.1f} s again" in PAGE


def _is_time(line):
    return line.startswith("| ") and " s | " in line and "] x | " in line and "goal" not in line


def _by_story(rows):
    story = -1
    for row in rows:
        story += row[0] == "Linux default"
        yield story, row
