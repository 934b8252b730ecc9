"""Blocks are drawn together, and figures over drawn blocks are what they would be over these blocks."""

from __future__ import annotations

import random

import numpy as np
import pytest

from tests.bench.enforcement.figures import Figures, Run
from tests.bench.enforcement.intervals import Drawn, Paired, interval
from tests.bench.enforcement.stories import IMPORTANCE, tasks

TASKS = {task.name: task for task in tasks(0.7)}
CONTEXTS = [context.name for context in IMPORTANCE.contexts]


def a_run(number, inputs=30, dropped=0.1):
    """Random responses; some inputs are dropped."""
    numbers = random.Random(number)  # noqa: S311 - no secret

    def response():
        return None if numbers.random() < dropped else numbers.randrange(2000)

    responses = {task: {context: [response() for _ in range(inputs)] for context in CONTEXTS} for task in TASKS}
    return Run(responses, {"all": numbers.uniform(5, 9)}, 0.0)


def cell(*runs, blocks=None, places=None):
    blocks = list(range(len(runs))) if blocks is None else blocks
    return Figures(IMPORTANCE, TASKS, list(runs), blocks, blocks if places is None else places)


@pytest.mark.parametrize("dropped", [0.0, 0.006, 0.3])
def test_figures_over_drawn_blocks_are_those_of_just_these_runs(dropped):
    runs = [a_run(number, 10 + 30 * number, dropped) for number in range(4)]
    sets = np.random.default_rng(1).multinomial(4, [0.25] * 4, 50)
    counts = np.concatenate([np.ones((1, 4), int), sets])
    drawn = Drawn(cell(*runs), range(4), counts)
    hits, times, work = drawn.hit("slam", ["drive"]), drawn.quantile("slam", 0.99), drawn.work()
    for place, times_drawn in enumerate(counts.tolist()):
        same = cell(*(run for run, number in zip(runs, times_drawn, strict=True) for _ in range(number)))
        assert hits[place] == pytest.approx(same.hit("slam", ["drive"]))
        assert times[place] == same.quantile("slam", 0.99)
        assert work[place] == pytest.approx(same.work)


def test_interval_holds_95_percent_of_the_drawn_figures():
    found = interval(np.array([7.0, *range(1000)]))
    assert (found.whole, found.least, found.most) == (7.0, 25.0, 974.0)


def test_a_figure_that_is_not_a_number_is_the_least():
    assert interval(np.array([np.nan] * 9)).most == -np.inf


def test_the_same_figures_give_the_same_interval():
    one, other = (Paired(cell(*map(a_run, range(6))), resamples=50).drawn[0].hit("map") for _ in range(2))
    assert list(one) == list(other)


def test_only_common_blocks_are_compared():
    one = cell(a_run(1), a_run(2), a_run(3), places=[0, 2, 5])
    other = cell(a_run(4), a_run(5), blocks=[0, 2], places=[1, 4])
    paired = Paired(one, other, resamples=5)
    assert (paired.blocks, paired.interleaved) == ([0, 2], True)
    assert [list(drawn.figures.blocks) for drawn in paired.drawn] == [[0, 2], [0, 2]]


@pytest.mark.parametrize(
    ("places", "interleaved"),
    [
        (([0, 2, 4], [1, 3, 5]), True),
        (([0, 3, 40], [1, 2, 7]), True),
        (([10, 20, 30], [11, 19, 33]), True),
        (([0, 1, 2], [3, 4, 5]), False),
        (([0, 2, 3], [1, 4, 5]), False),
        (([0, 3, 5], [4, 2, 6]), False),
    ],
)
def test_blocks_are_interleaved_if_each_is_measured_in_one_go(places, interleaved):
    one, other = (cell(*map(a_run, range(3)), places=own) for own in places)
    assert Paired(one, other).interleaved is interleaved
