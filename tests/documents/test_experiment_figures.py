"""What the pages say of the experiments is what the committed report has, which is computed from the committed data."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
REPORT, DETAILS, README, PAGE, PREDICTION = (
    (ROOT / name).read_text(encoding="utf-8")
    for name in (
        "timelines/results/report.md",
        "timelines/results/details.md",
        "README.md",
        "docs/measurements/paper-experiments.md",
        "docs/measurements/prediction.md",
    )
)
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


@pytest.fixture(scope="module")
def chains():
    return table("frames that led to a wheel command")


def test_blocks_are_counted(heavy):
    counted = {heavy[row]["blocks"] for row in ROWS}
    assert [{count} for count in re.findall(r"(\d+) randomised blocks?", README)] == [counted]
    assert [{count} for count in re.findall(r"(\d+) blocks? of two held-out stories", PAGE)] == [counted]


@pytest.mark.parametrize("page", [README, PAGE], ids=["README", "page"])
@pytest.mark.parametrize("row", ROWS)
def test_what_contexts_gain_and_cost(row, page, heavy, costs, chains):
    own, all_, wheels = (one[row] for one in (heavy, costs, chains))
    cells = [
        *(own[column] for column in ("drive: slam", "read: signs")),
        wheels["frames that led to a wheel command"].removesuffix(" %"),
        *(all_[column] for column in ("slam", "signs", "signs read while reading, %", "signs read, %")),
        own["of the tasks' CPU used, %"],
    ]
    assert f"| {row} | {' | '.join(cells)} |" in page


def test_predictions_are_scored_as_in_the_details():
    found = r"\| (of all|[^|]*, where over 5 % are missed[^|]*) \|.*"
    scores = [line for line in DETAILS.splitlines() if re.fullmatch(found, line)]
    assert len(scores) == 5
    assert all(line in PREDICTION for line in scores)
