"""The search finds what helps, says only what matters, and never runs on."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.policy.parsing import parse
from contextpolicy.simulation.forecast import ALL, Forecast, stats
from contextpolicy.simulation.knobs import Knob, Path, knobs, patch, turned
from contextpolicy.simulation.search import Goal, cost, lowest_floors, search
from contextpolicy.simulation.server import Fate, Outcome, Work

RESOURCE: dict[str, Any] = {
    "metadata": {"name": "p", "namespace": "n"},
    "spec": {
        "streams": [{"name": "imu", "key": "robot/imu"}],
        "tasks": [
            {
                "name": "slam",
                "selector": {"matchLabels": {"app": "slam"}},
                "priority": 10,
                "idle": 0.1,
                "min": "100m",
                "activity": [{"stream": "imu", "when": "imu.speed > 0", "hold": "1s"}],
            },
            {"name": "speech", "selector": {"matchLabels": {"app": "speech"}}},
        ],
        "contexts": [
            {"name": "moving", "when": "imu.speed > 0", "tasks": {"speech": {"suspend": True}, "slam": {"weight": 10}}}
        ],
    },
}
A, B = ("a",), ("b",)


def paths(demand, *, delays=False):
    return [str(knob) for knob in knobs(RESOURCE, demand, delays=delays)]


def test_only_numbers_are_varied_bounds_first():
    assert paths({"slam": 0.4}) == [
        "/spec/tasks/0/min",
        "/spec/tasks/0/max",
        "/spec/contexts/0/tasks/slam/weight",
        "/spec/tasks/0/priority",
        "/spec/tasks/0/idle",
        "/spec/tasks/1/priority",
    ]


def test_delays_and_holds_are_varied_on_request():
    assert paths({"slam": 0.4}, delays=True)[-3:] == [
        "/spec/contexts/0/enterAfter",
        "/spec/contexts/0/exitAfter",
        "/spec/tasks/0/activity/0/hold",
    ]


@given(st.integers(1, 80), st.integers(1, 80))
def test_a_floor_is_lowered_to_the_least_that_suffices(start, least):
    floor = knobs(RESOURCE, {"slam": 0.4})[0]
    found = {floor.path: f"{10 * max(start, least)}m", A: 1}
    lowered = lowest_floors([floor], found, lambda values: int(values[floor.path][:-1]) >= 10 * least)
    assert lowered == {floor.path: f"{10 * least}m", A: 1}


def test_an_unchanged_floor_is_not_lowered():
    floor = knobs(RESOURCE, {"slam": 0.4})[0]
    assert lowest_floors([floor], {A: 1}, lambda _: True) == {A: 1}


def test_bounds_follow_from_what_a_task_needs():
    floor = knobs(RESOURCE, {"slam": 0.4})[0]
    assert floor.values == ("440m", "600m", "800m", "50m", "200m")


@pytest.mark.parametrize("knob", knobs(RESOURCE, {"slam": 0.4, "speech": 0.001}, delays=True), ids=str)
def test_every_variation_is_valid_and_keeps_the_original(knob):
    for value in knob.values:
        policy = parse(turned(RESOURCE, {knob.path: value}))
        assert [task.name for task in policy.tasks] == ["slam", "speech"]
    assert RESOURCE["spec"]["tasks"][0]["min"] == "100m"
    assert "priority" not in RESOURCE["spec"]["tasks"][1]


def test_a_patch_replaces_what_is_there_and_adds_what_is_not():
    values = {("spec", "tasks", 0, "min"): "440m", ("spec", "contexts", 0, "tasks", "a/b~c", "weight"): 5}
    resource = {"spec": {"tasks": [{"min": "1"}], "contexts": [{"tasks": {"a/b~c": {}}}]}}
    assert patch(resource, values) == [
        {"op": "add", "path": "/spec/contexts/0/tasks/a~1b~0c/weight", "value": 5},
        {"op": "replace", "path": "/spec/tasks/0/min", "value": "440m"},
    ]


def test_it_changes_only_what_helps():
    asked = []

    def judge(values):
        asked.append(values)
        return 10 - values.get(A, 0)  # b does nothing

    found = search([Knob(B, (1, 2)), Knob(A, (1, 2, 3))], judge, 100)
    assert (found.values, found.before, found.after) == ({A: 3}, 10, 7)
    assert found.tries == len(asked)


def test_changes_that_became_useless_are_reverted():
    """a helps only until b is there."""
    costs: dict[frozenset[Path], int] = {frozenset(): 10, frozenset({A}): 5, frozenset({A, B}): 1, frozenset({B}): 1}
    found = search([Knob(A, (1,)), Knob(B, (1,))], lambda values: costs[frozenset(values)], 100)
    assert found.values == {B: 1}


def test_a_refused_policy_is_never_suggested():
    found = search([Knob(A, (1, 2))], lambda values: float("inf") if values.get(A) == 1 else 5 - len(values), 100)
    assert found.values == {A: 2}


@given(st.lists(st.floats(0, 10), min_size=8, max_size=8), st.integers(1, 20))
def test_search_never_gets_worse_and_stops_at_its_limit(table, tries):
    asked = []

    def judge(values):
        asked.append(values)
        return table[values.get(A, 0) * 2 + values.get(B, 0)]

    found = search([Knob(A, (1, 2, 3)), Knob(B, (1,))], judge, tries)
    assert found.after <= found.before
    assert len(asked) <= tries + 2  # taking back may need to know one more for each change
    assert judge(found.values) == found.after


def a_forecast(plans=0.0, **tasks):
    """Late, in time, and suspended inputs of each task."""
    made = {}
    for name, (late, good, suspended) in tasks.items():
        fates = [(Fate.DONE, 1.0)] * late + [(Fate.DONE, 0.0)] * good + [(Fate.SUSPENDED, 0.0)] * suspended
        outcomes = [Outcome(Work(0.0, name, 0, 0.1), fate, time, 0) for fate, time in fates]
        made[name] = {ALL: stats(outcomes, 0.5)}
    return Forecast({}, {}, made, {}, plans)


def test_misses_count_by_priority_and_above_the_goal_a_hundredfold():
    goals = {"slam": Goal(9, 0.1), "speech": Goal(1, 0.1)}
    before = [a_forecast(slam=(0, 10, 0), speech=(0, 10, 0))]
    assert cost(before, before, goals) == 0
    assert cost([a_forecast(slam=(1, 9, 0), speech=(0, 10, 0))], before, goals) == pytest.approx(0.9 * 0.1)
    assert cost([a_forecast(slam=(2, 8, 0), speech=(0, 10, 0))], before, goals) == pytest.approx(0.9 * (0.2 + 10))
    assert cost([a_forecast(slam=(0, 10, 0), speech=(1, 9, 0))], before, goals) == pytest.approx(0.1 * 0.1)


def test_unfinished_inputs_count_as_misses():
    goals = {"slam": Goal(1, 0.0)}
    before = [a_forecast(slam=(5, 5, 0))]
    assert cost([a_forecast(slam=(0, 5, 5))], before, goals) == pytest.approx(cost(before, before, goals))


def test_fewer_plans_break_a_tie():
    goals = {"slam": Goal(1, 0.0)}
    before = [a_forecast(slam=(0, 10, 0))]
    assert cost([a_forecast(plans=2.0, slam=(0, 10, 0))], before, goals) == pytest.approx(0.02)
