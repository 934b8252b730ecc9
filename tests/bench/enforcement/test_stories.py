"""Loads, contexts on a script, and when gates are open."""

import math

import pytest

from tests.bench.enforcement.stories import (
    BASE,
    IMPORTANCE,
    PROCESSORS,
    STORIES,
    SUSPENDING,
    Script,
    critical_fit,
    tasks,
)


@pytest.mark.parametrize("load", [0.7, 1.6])
def test_load_is_the_total_demand_per_processor(load):
    assert sum(task.wants for task in tasks(load)) == pytest.approx(load * PROCESSORS)


def test_a_load_keeps_rates_and_deadlines():
    assert [(task.rate, task.deadline) for task in tasks(0.7)] == [(task.rate, task.deadline) for task in BASE]


def test_every_task_alone_can_meet_its_deadline_under_every_load():
    assert all(task.cost < min(task.deadline, 1 / task.rate) for task in tasks(1.6))


def test_the_loads_are_on_both_sides_of_what_the_critical_tasks_want():
    assert critical_fit(1.3)
    assert not critical_fit(1.6)


def test_no_context_suspends_its_critical_or_a_protected_task():
    protected = {task.name for task in BASE if task.protected}
    for story in STORIES.values():
        for context in story.contexts:
            assert not context.suspends & (protected | {context.critical})


def test_the_last_context_stays():
    script = Script(IMPORTANCE, 2.0)
    assert [script.at(time).name for time in (0.0, 1.9, 2.0, 5.9, 7.0)] == ["drive", "drive", "talk", "read", "read"]


def test_gates_are_open_while_no_context_suspends_the_task():
    script = Script(SUSPENDING, 2.0)
    assert script.windows("signs") == [(2.0, math.inf)], "suspended in the first context"
    assert script.windows("map") == [(0.0, 2.0), (4.0, math.inf)], "in the second"
    assert script.windows("slam") == [(0.0, 4.0)], "in the last"
    assert script.windows("nav") == [(0.0, math.inf)]


def test_phases_are_within_a_period_and_differ_by_task_and_block():
    one, other = Script(IMPORTANCE, 2.0, seed=1), Script(IMPORTANCE, 2.0, seed=2)
    assert all(0 <= one.phase(task) < 1 / task.rate for task in BASE)
    assert len({one.phase(task) * task.rate for task in BASE}) == len(BASE)
    assert [one.phase(task) for task in BASE] != [other.phase(task) for task in BASE]


def test_every_input_that_is_counted_arrives_before_the_end():
    script = Script(IMPORTANCE, 2.0, seed=1)
    for task in BASE:
        last = script.phase(task) + (script.count(task) - 1) / task.rate
        assert last < script.end <= last + 1 / task.rate + 1e-9
