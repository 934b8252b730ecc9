"""Every cell is measured or left out for a reason, and blocks are shuffled the same way in every run."""

import pytest

from tests.bench.enforcement.divisions import ALONE, DEFAULT, PRIORITY, STATIC, SUSPENSION, WEIGHTS
from tests.bench.enforcement.inputs import Queue
from tests.bench.enforcement.matrix import BESIDE, HEAVY, LIGHT, Cell, cells, for_goals, in_block, stand_in, taken
from tests.bench.enforcement.policy import ATTEMPTS
from tests.bench.enforcement.stories import IMPORTANCE, SUSPENDING, Script, tasks

MEASURED, LEFT_OUT = cells(attempts=True)


def test_a_cell_is_measured_or_left_out_with_a_reason():
    assert not set(MEASURED) & set(LEFT_OUT)
    assert len(MEASURED) + len(LEFT_OUT) == 2 * 4 * 2 * 2 * (10 + len(ATTEMPTS))
    assert all(LEFT_OUT.values())


def test_a_substitute_cell_differs_only_without_effect():
    ungated = Cell(SUSPENDING.name, 1.3, Queue.NEWEST, gated=False, division=PRIORITY)
    assert stand_in(ungated) == Cell(IMPORTANCE.name, 1.3, Queue.NEWEST, gated=False, division=PRIORITY)
    gated = Cell(SUSPENDING.name, 1.3, Queue.NEWEST, gated=True, division=PRIORITY)
    assert stand_in(gated) == gated, "gating changes what the machine does"
    contextual = Cell(SUSPENDING.name, 1.3, Queue.NEWEST, gated=False, division=WEIGHTS)
    assert stand_in(contextual) == contextual, "so does suspension"


@pytest.mark.parametrize("load", HEAVY)
def test_cells_that_goals_compare_are_in_every_block(load):
    last = in_block(MEASURED, BESIDE)
    for name in (DEFAULT, ALONE, WEIGHTS):
        assert Cell(IMPORTANCE.name, load, Queue.NEWEST, gated=False, division=name) in last
    for name in (*STATIC, WEIGHTS):
        assert Cell(SUSPENDING.name, load, Queue.NEWEST, gated=True, division=name) in last
    for cell in (
        Cell(IMPORTANCE.name, LIGHT, Queue.NEWEST, gated=False, division=DEFAULT),
        Cell(IMPORTANCE.name, LIGHT, Queue.NEWEST, gated=False, division=WEIGHTS),
        *(
            Cell(SUSPENDING.name, LIGHT, Queue.NEWEST, gated=True, division=division)
            for division in (DEFAULT, WEIGHTS, SUSPENSION)
        ),
    ):
        assert cell in last


def test_the_first_blocks_have_all_cells_and_each_its_own_order():
    first, second = in_block(MEASURED, 0), in_block(MEASURED, 1)
    assert set(first) == set(second) == set(MEASURED)
    assert first != second
    assert first == in_block(reversed(MEASURED), 0)


def test_later_blocks_have_what_goals_compare():
    assert set(in_block(MEASURED, BESIDE)) == {cell for cell in MEASURED if for_goals(cell)} < set(MEASURED)


def test_alone_means_that_only_the_critical_task_has_input():
    cell = Cell(IMPORTANCE.name, 1.3, Queue.NEWEST, gated=False, division=ALONE)
    windows = {task.name: taken(cell, task, Script(IMPORTANCE, 2.0)).windows for task in tasks(1.3)}
    assert windows == {"slam": [(0, 2)], "speech": [(2, 4)], "signs": [(4, 6)], "nav": [], "imu": [], "map": []}


def test_only_gated_cells_close_gates():
    signs = next(task for task in tasks(1.3) if task.name == "signs")
    for gated, opens in ((True, 2.0), (False, 0.0)):
        cell = Cell(SUSPENDING.name, 1.3, Queue.NEWEST, gated, WEIGHTS)
        assert taken(cell, signs, Script(SUSPENDING, 2.0)).windows[0][0] == opens
