"""The README's figures are those of committed measurements."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests.bench.enforcement.divisions import DEFAULT, LIMITS, ROUND_ROBIN, STATIC, WEIGHTS
from tests.bench.enforcement.inputs import Queue
from tests.bench.enforcement.journal import Journal
from tests.bench.enforcement.matrix import CONFLICTING, LIGHT, Cell
from tests.bench.enforcement.opponents import best_static
from tests.bench.enforcement.stories import IMPORTANCE

ROOT = Path(__file__).parents[2]
MEASURED = ROOT / "docs" / "measurements" / "enforcement.jsonl"
README = (ROOT / "README.md").read_text(encoding="utf-8")
ROWS = {
    "plain Linux": DEFAULT,
    "slam under SCHED_RR, the best static of five": ROUND_ROBIN,
    "context weights, the default": WEIGHTS,
    "context limits, the paper's way": LIMITS,
}


@pytest.fixture(scope="module")
def journal():
    options = json.loads(MEASURED.read_text(encoding="utf-8").split("\n", 1)[0])
    return Journal(MEASURED, options, resume=True)


@pytest.mark.parametrize("row", ROWS)
def test_gain(row, journal):
    light, heavy = (journal.figures(_cell(load, ROWS[row])) for load in (LIGHT, CONFLICTING))
    cells = [_percent(light.hit("imu")), _percent(light.hit("map")), f"{light.work:.2f} s"] if light else [""] * 3
    assert list(heavy.critical()) == ["drive", "talk", "read"]
    cells += [*map(_percent, heavy.critical().values()), f"{heavy.work:.2f} s"]
    assert f"| {row} | {' | '.join(cells)} |".replace("|  ", "| ") in README


def test_the_static_row_is_the_best_of_those_measured(journal):
    best = best_static(journal.figures, IMPORTANCE.name, CONFLICTING, gated=False)
    assert best is not None
    assert ROWS["slam under SCHED_RR, the best static of five"] == best.division
    assert all(journal.figures(_cell(CONFLICTING, division)) for division in STATIC)
    assert len(STATIC) == 5


def test_reactions():
    """The first column of the reaction benchmark, and of the one on an emulated board."""
    text = (ROOT / "docs" / "measurements" / "reaction.md").read_text(encoding="utf-8")
    agent, slow_agent = (
        float(one) for one in re.findall(r"\| operator, node agent \| ([\d.]+) \|[^\n]*\d \|", text)[:2]
    )
    resize, slow_resize = (float(one) for one in re.findall(r"\| operator, resize \| ([\d.]+) \|", text)[:2])
    assert f"quota changes {agent:g} ms after the sample with the node agent and {resize:g} ms without it" in README
    assert all(2 <= slow <= 3 for slow in (slow_agent / agent, slow_resize / resize))
    assert "two to three times as long" in README


def test_the_readme_is_short():
    assert len(README.split()) <= 900


def _cell(load, division):
    return Cell(IMPORTANCE.name, load, Queue.NEWEST, gated=False, division=division)


def _percent(part):
    return f"{part:.1%}".replace(".0%", "%").replace("%", " %")
