"""The search is the same every time, and finds what a user would not."""

from dataclasses import replace

import pytest

from tests.bench.enforcement.divisions import PRIORITY, TUNED, division, weighted
from tests.bench.enforcement.figures import Figures, Run
from tests.bench.enforcement.inputs import Queue
from tests.bench.enforcement.matrix import Cell
from tests.bench.enforcement.search import (
    BUDGET,
    FINALISTS,
    Candidate,
    Score,
    score,
    simple,
    simulated,
    tried,
    tune,
)
from tests.bench.enforcement.stories import IMPORTANCE, Script, tasks

CELL = Cell(IMPORTANCE.name, 1.3, Queue.NEWEST, gated=False, division=TUNED)
SCRIPT = Script(IMPORTANCE, 1.0)
TASKS = tasks(1.3)


def figures(**misses):
    """Of a run with ten inputs for each task and context, less the misses by `task_context`."""
    responses = {
        task.name: {
            context.name: [None] * misses.get(f"{task.name}_{context.name}", 0)
            + [1] * (10 - misses.get(f"{task.name}_{context.name}", 0))
            for context in IMPORTANCE.contexts
        }
        for task in TASKS
    }
    return Figures(IMPORTANCE, {task.name: task for task in TASKS}, [Run(responses, {}, 0.0)])


def test_budget_is_at_least_200_trials():
    assert BUDGET >= 200


def test_search_is_repeatable_and_beats_untuned_weights():
    found = tune(CELL, TASKS, SCRIPT, budget=60)
    assert found == tune(CELL, TASKS, SCRIPT, budget=60)
    best, untuned = found[:FINALISTS], found[FINALISTS:]
    assert best == sorted(best, reverse=True)
    assert best[0].score.worst > max(untuned).score.worst, "here it finds something better"


@pytest.mark.parametrize("finalists", [1, FINALISTS])
def test_equal_weights_and_those_by_priority_are_always_run(finalists):
    found = tune(CELL, TASKS, SCRIPT, finalists, budget=20)
    assert len(found) == finalists + 2
    equal, by_priority = (dict(candidate.shares) for candidate in found[-2:])
    assert len(set(equal.values())) == 1
    assert weighted(by_priority) == division(PRIORITY, IMPORTANCE, TASKS).settings["drive"]


def test_untuned_weights_that_are_among_the_best_are_run_once():
    found = tune(CELL, TASKS, SCRIPT, FINALISTS, budget=len(simple(TASKS, SCRIPT)))
    assert len(set(found)) == len(found) < FINALISTS + 2


def test_a_finalist_is_judged_by_the_worse_of_two_runs():
    candidates = [Candidate(Score(0.9, 0.9, 0.9), (("slam", shares),)) for shares in (1, 2, 3)]
    missed = {1: (0, 9), 2: (4, 4), 3: (5, 0)}
    asked = []

    def run(shares, block):
        asked.append((shares["slam"], block))
        return figures(slam_drive=missed[shares["slam"]][block])

    first, *others = tried(candidates, run)
    assert asked == [(number, block) for number in (1, 2, 3) for block in (0, 1)]
    assert [first.candidate, *(one.candidate for one in others)] == [candidates[1], candidates[2], candidates[0]]
    assert others[1].values() == {
        "shares": {"slam": 1},
        "simulated": 0.9,
        "runs": 2,
        "critical": {"drive": pytest.approx(0.1), "talk": 1, "read": 1},
    }


def test_the_model_reports_weights_apart():
    slam_first = {task.name: 4096 if task.name == "slam" else 8 for task in TASKS}
    run = simulated(slam_first, CELL, TASKS, SCRIPT)
    found = Figures(IMPORTANCE, {task.name: task for task in TASKS}, [run]).critical()
    assert found["drive"] == 1
    assert found["read"] < 0.5


def test_score_ranks_the_worst_context_before_other_tasks():
    def rated(**misses):
        return score(figures(**misses))

    assert rated(slam_drive=3, speech_talk=3, signs_read=3) > rated(signs_read=4), "the worst one counts"
    assert rated(map_drive=10) > rated(slam_drive=1), "before all tasks that are not critical"
    assert rated(slam_drive=3) > rated(nav_talk=4)
    assert rated(signs_read=4) > rated(signs_read=4, slam_drive=1), "then the other contexts"


def test_gates_change_the_simulated_work():
    signs_first = {task.name: 4096 if task.name == "signs" else 8 for task in TASKS}
    ungated = simulated(signs_first, CELL, TASKS, SCRIPT)
    assert ungated == simulated(signs_first, replace(CELL, division="anything"), TASKS, SCRIPT)
    assert sum(ungated.work.values()) <= 2 * SCRIPT.end + 1e-6
