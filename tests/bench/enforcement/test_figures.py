"""Nothing that was due is forgotten."""

import math

import pytest

from tests.bench.enforcement.figures import Figures, Run
from tests.bench.enforcement.stories import IMPORTANCE, SUSPENDING, Script, Task

SLAM = Task("slam", rate=10, cost=0.07, deadline=0.1, priority=8)
SCRIPT = Script(IMPORTANCE, 1.0, seed=3)
NEVER = math.nan


def a_run(finished, script=SCRIPT, drained=("slam",), **others):
    return Run.of([SLAM], script, {"slam": finished}, {"slam": 1.0}, drained, **others)


def figures(*runs, story=IMPORTANCE):
    return Figures(story, {"slam": SLAM}, runs)


def every(response, script=SCRIPT):
    return [script.phase(SLAM) + number / 10 + response for number in range(script.count(SLAM))]


def test_dropped_or_unfinished_input_is_a_miss():
    finished = every(0.09)
    finished[0] = finished[12] = NEVER
    assert figures(a_run(finished)).hit("slam") == pytest.approx(28 / 30)
    assert figures(a_run(finished)).hit("slam", ["drive"]) == pytest.approx(0.9)
    assert figures(a_run(finished)).hit("slam", ["read"]) == 1


def test_late_input_is_a_miss():
    finished = every(0.09)
    finished[5] += 0.02
    assert figures(a_run(finished)).hits("slam") == [pytest.approx(29 / 30)]


def test_an_input_counts_in_the_context_in_which_it_arrives():
    finished = every(0.09)
    finished[9] += 0.5  # done in the second context
    found = figures(a_run(finished))
    assert found.hit("slam", ["drive"]) == pytest.approx(0.9)
    assert found.hit("slam", ["talk"]) == 1


def test_input_of_a_suspended_task_is_not_counted():
    script = Script(SUSPENDING, 1.0, seed=3)
    finished = every(0.09, script)
    finished[20:] = [NEVER] * 10
    assert figures(a_run(finished, script), story=SUSPENDING).hit("slam") == 1
    assert math.isnan(figures(a_run(finished, script), story=SUSPENDING).hit("slam", ["read"]))
    assert figures(a_run(finished)).hit("slam") == pytest.approx(20 / 30), "nothing suspends it in this story"


def test_a_task_that_drops_inputs_has_no_finite_p99():
    finished = every(0.09)
    finished[0] = NEVER
    found = figures(a_run(finished))
    assert found.quantile("slam", 0.5) == pytest.approx(0.09)
    assert math.isinf(found.quantile("slam", 0.99))


def test_quantiles_are_over_all_blocks():
    found = figures(a_run(every(0.02)), a_run(every(0.08)))
    assert found.quantile("slam", 0.5) == pytest.approx(0.02)
    assert found.quantile("slam", 0.51) == pytest.approx(0.08)


def test_critical_is_each_context_s_own_task():
    names = ("slam", "speech", "signs")
    responses: dict[str, dict[str, list[int | None]]] = {
        name: {"drive": [1], "talk": [1], "read": [1]} for name in names
    }
    responses["signs"]["read"] = [None]
    tasks = dict.fromkeys(responses, SLAM)
    found = Figures(IMPORTANCE, tasks, [Run(responses, {}, 0.0)])
    assert found.critical() == {"drive": 1, "talk": 1, "read": 0}


def test_drain_is_the_time_worked_after_the_last_context():
    assert a_run(every(0.0)).drain == 0
    finished = every(0.0)
    finished[-1] = 3.4
    assert a_run(finished).drain == pytest.approx(0.4)


def test_a_drain_that_took_too_long_in_most_blocks_has_no_median():
    quick, slow = a_run(every(0.0)), a_run(every(0.0), drained=None)
    assert figures(quick, slow, slow).drain is None
    assert figures(quick, quick, slow).drain == 0


def test_a_run_is_the_same_after_it_was_written_and_read():
    run = a_run(every(0.09), late=0.001, foreign=0.2)
    assert Run(**run.values()) == run
