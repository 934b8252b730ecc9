"""The search is the same every time, and finds what a user would not."""

from dataclasses import replace

from tests.bench.enforcement.divisions import TUNED
from tests.bench.enforcement.figures import Figures, Run
from tests.bench.enforcement.inputs import Queue
from tests.bench.enforcement.matrix import Cell
from tests.bench.enforcement.search import BUDGET, FINALISTS, score, simple, simulated, tune
from tests.bench.enforcement.stories import IMPORTANCE, Script, tasks

CELL = Cell(IMPORTANCE.name, 1.3, Queue.NEWEST, gated=False, division=TUNED)
SCRIPT = Script(IMPORTANCE, 1.0)
TASKS = tasks(1.3)


def test_the_budget_is_what_was_promised():
    assert BUDGET >= 200


def test_the_search_is_repeatable_and_no_worse_than_what_a_user_would_write():
    found = tune(CELL, TASKS, SCRIPT, budget=60)
    assert found == tune(CELL, TASKS, SCRIPT, budget=60)
    assert len(found) == FINALISTS + 1
    *best, plain = found
    assert best == sorted(best, reverse=True)
    assert best[0] >= plain
    assert best[0].score.worst > plain.score.worst, "here it finds something better"
    assert dict(plain.shares) in simple(TASKS, SCRIPT)


def test_the_model_tells_weights_apart():
    slam_first = {task.name: 4096 if task.name == "slam" else 8 for task in TASKS}
    run = simulated(slam_first, CELL, TASKS, SCRIPT)
    found = Figures(IMPORTANCE, {task.name: task for task in TASKS}, [run]).critical()
    assert found["drive"] == 1
    assert found["read"] < 0.5


def test_the_worst_context_counts_and_starving_a_protected_task_does_not_pay():
    def rated(**misses):
        responses = {
            task.name: {
                context.name: [None] * misses.get(f"{task.name}_{context.name}", 0)
                + [1] * (10 - misses.get(f"{task.name}_{context.name}", 0))
                for context in IMPORTANCE.contexts
            }
            for task in TASKS
        }
        return score(Figures(IMPORTANCE, {task.name: task for task in TASKS}, [Run(responses, {}, 0.0)]))

    assert rated(slam_drive=3, speech_talk=3, signs_read=3) > rated(signs_read=4), "the worst one counts"
    assert rated(map_drive=10) > rated(slam_drive=1), "before all tasks that are not critical"
    assert rated(slam_drive=3) > rated(nav_talk=4)
    assert rated(signs_read=4) > rated(signs_read=4, slam_drive=1), "then the other contexts"


def test_gates_change_what_is_found():
    signs_first = {task.name: 4096 if task.name == "signs" else 8 for task in TASKS}
    ungated = simulated(signs_first, CELL, TASKS, SCRIPT)
    assert ungated == simulated(signs_first, replace(CELL, division="anything"), TASKS, SCRIPT)
    assert sum(ungated.work.values()) <= 2 * SCRIPT.end + 1e-6
