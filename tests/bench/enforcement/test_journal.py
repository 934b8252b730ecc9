"""A run that was stopped goes on where it was."""

import pytest

from tests.bench.enforcement.divisions import DEFAULT, TUNED, WEIGHTS
from tests.bench.enforcement.figures import Run
from tests.bench.enforcement.inputs import Queue
from tests.bench.enforcement.journal import Journal
from tests.bench.enforcement.matrix import Cell
from tests.bench.enforcement.stories import IMPORTANCE, SUSPENDING

OPTIONS = {"seconds": 4.0, "loads": [0.7, 1.3]}
CELL = Cell(IMPORTANCE.name, 1.3, Queue.NEWEST, gated=False, division=DEFAULT)
RUN = Run({"slam": {"drive": [612, None]}}, {"slam": 1.5}, None, 0.001, 0.2)


@pytest.fixture
def file(tmp_path):
    return tmp_path / "results" / "enforcement.jsonl"


def test_measured_runs_are_resumed(file):
    first = Journal(file, OPTIONS, resume=False)
    first.add(CELL, 0, RUN)
    first.add_tuned(CELL, {"slam": 900}, [{"shares": {"slam": 900}}])
    again = Journal(file, OPTIONS, resume=True)
    assert again.has(CELL, 0)
    assert not again.has(CELL, 1)
    assert again.runs() == [(CELL, 0, RUN)]
    assert again.tuned == {CELL: {"slam": 900}}


def test_context_independent_cell_reuses_its_substitute(file):
    journal = Journal(file, OPTIONS, resume=False)
    journal.add(CELL, 0, RUN)
    same = Cell(SUSPENDING.name, 1.3, Queue.NEWEST, gated=False, division=DEFAULT)
    figures = journal.figures(same)
    assert figures is not None
    assert figures.story is SUSPENDING
    assert journal.figures(Cell(SUSPENDING.name, 1.3, Queue.NEWEST, gated=True, division=DEFAULT)) is None
    assert journal.figures(Cell(SUSPENDING.name, 1.3, Queue.NEWEST, gated=False, division=WEIGHTS)) is None
    assert journal.figures(Cell(IMPORTANCE.name, 1.6, Queue.NEWEST, gated=False, division=TUNED)) is None
