"""The model of the fair scheduler, in cases whose answer is known."""

import math

import pytest

from tests.bench.enforcement.inputs import Inputs, Queue
from tests.bench.enforcement.simulator import Simulated, simulate

ALWAYS = [(0.0, math.inf)]


def a_task(cost, rate=10.0, weight=1024.0, count=20, queue=Queue.NEWEST):
    return Simulated(Inputs(rate, count, queue, ALWAYS), cost, weight)


def done(finished):
    return [time for time in finished if not math.isnan(time)]


def test_a_task_alone_is_done_after_its_cost():
    found = simulate({"one": a_task(0.05)}, 10)["one"]
    assert found == pytest.approx([number / 10 + 0.05 for number in range(20)])


def test_two_tasks_do_not_disturb_each_other_on_two_processors():
    found = simulate({"one": a_task(0.09), "other": a_task(0.09)}, 10)
    assert found["one"] == found["other"] == pytest.approx([number / 10 + 0.09 for number in range(20)])


def test_no_processor_idles_while_a_task_waits():
    tasks = {name: a_task(0.07, queue=Queue.LOSSLESS, count=30) for name in ("a", "b", "c", "d")}
    found = simulate(tasks, 3.0)
    work = sum(0.07 * len(done(times)) for times in found.values())
    assert work == pytest.approx(2 * 3.0, abs=4 * 0.07)


def test_idle_processor_steals_waiting_jobs():
    short, long = {"cost": 0.01, "count": 1}, {"cost": 0.06, "count": 1}
    found = simulate({"a": a_task(**short), "b": a_task(**long), "c": a_task(**short), "d": a_task(**long)}, 1)
    assert max(time for times in found.values() for time in times) < 0.09, "one after the other they take 0.12 s"


def test_a_heavy_task_is_served_first_and_equal_ones_alike():
    heavy = simulate({"a": a_task(0.08, weight=4096), **{n: a_task(0.08, weight=64) for n in "bcd"}}, 3)
    assert max(time - number / 10 for number, time in enumerate(heavy["a"])) < 0.1
    assert len(done(heavy["b"])) < len(done(heavy["a"]))
    equal = simulate({n: a_task(0.08, weight=64) for n in "abcd"}, 3)
    assert len({len(done(times)) for times in equal.values()}) == 1


def test_weights_divide_a_processor():
    tasks = {
        "keeps the other processor": a_task(0.2, weight=1024, count=200, queue=Queue.LOSSLESS),
        "three": a_task(0.05, rate=20, weight=300, count=400, queue=Queue.LOSSLESS),
        "one": a_task(0.05, rate=20, weight=100, count=400, queue=Queue.LOSSLESS),
    }
    found = simulate(tasks, 20)
    whole = len(done(found["one"])) + len(done(found["three"]))
    assert len(done(found["three"])) / whole == pytest.approx(0.75, abs=0.05)


def test_a_short_task_does_not_wait_for_a_long_one_of_the_same_weight_to_end():
    tasks = {"short": a_task(0.001, rate=100, count=100), "a": a_task(0.09), "b": a_task(0.09)}
    found = simulate(tasks, 1.0)["short"]
    assert max(time - number / 100 for number, time in enumerate(found)) < 0.01


def test_job_cut_off_by_the_end_is_never_done():
    assert math.isnan(simulate({"one": a_task(0.05)}, 0.12)["one"][1])
