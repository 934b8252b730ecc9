"""The README's figures, and the tables of the page on enforcement, are those of committed measurements."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.bench.enforcement.divisions import DEFAULT, LIMITS, WEIGHTS
from tests.bench.enforcement.inputs import Queue
from tests.bench.enforcement.matrix import LIGHT, Cell
from tests.bench.enforcement.published import load, tables
from tests.bench.enforcement.stories import IMPORTANCE

ROOT = Path(__file__).parents[2]
ENFORCEMENT = (ROOT / "docs" / "decisions" / "enforcement.md").read_text(encoding="utf-8")
README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def journal():
    return load()


def test_light_load(journal):
    plain, weights, limits = (journal.figures(_cell(LIGHT, one)) for one in (DEFAULT, WEIGHTS, LIMITS))
    tasks = ("nav", "imu", "slam", "speech", "signs", "map")
    assert all(weights.hit(task) >= plain.hit(task) - 0.01 for task in tasks)
    assert min(limits.hit(task) for task in tasks) == 0
    said = "every hit rate is within a point of plain Linux's, while limits lose up to all of a task's inputs"
    assert said in " ".join(README.split())


def test_tables_on_enforcement(journal):
    assert [what for what, table in tables(journal).items() if table not in ENFORCEMENT] == []


def test_reactions():
    """The first columns of the reaction benchmark, and of the one on an emulated board."""
    text = (ROOT / "docs" / "measurements" / "reaction.md").read_text(encoding="utf-8")
    (agent, agent_eight), (slow_agent, _) = _first_two(r"operator, node agent", text)
    (resize, resize_eight), (slow_resize, _) = _first_two(r"operator, resize", text)
    readme = " ".join(README.split())
    assert f"one container follows its sensor in {resize:g} ms, eight in {resize_eight:g} ms (medians)" in readme
    assert f"with the node agent, in {agent:g} and {agent_eight:g} ms" in readme
    assert all(2 <= slow <= 3 for slow in (slow_agent / agent, slow_resize / resize))
    assert "two to three times as long" in readme


def test_what_it_takes():
    text = (ROOT / "docs" / "measurements" / "operator.md").read_text(encoding="utf-8")
    [(memory, busy)] = re.findall(r"\| together \| (\d+) MiB \| [\d.]+ \| (\d+) \|", text)
    assert f"together take {memory} MiB, and {int(busy) / 1000:.2f} cores" in README


def _first_two(row, text):
    """The first two figures of a row in the first table that has it, and in the one of the slow board."""
    found = re.findall(rf"\| {row} \| ([\d.]+) \| ([\d.]+) \|[^\n]*\d \|", text)
    return [(float(one), float(eight)) for one, eight in found[:2]]


def test_how_long_all_tests_may_take():
    limit = re.search(r"(\d+) make test", (ROOT / ".ci" / "run").read_text(encoding="utf-8"))
    assert limit is not None
    contributing = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    assert f"CI stops it after {int(limit[1]) // 60} minutes" in contributing


def test_the_readme_is_short():
    assert len(README.split()) <= 900


def _cell(at, division):
    return Cell(IMPORTANCE.name, at, Queue.NEWEST, gated=False, division=division)
