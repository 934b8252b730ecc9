"""Tasks of tasks, and tasks that wait for each other."""

from __future__ import annotations

import pytest

from contextpolicy.errors import PolicyError
from tests.planning.builders import a_parent, a_policy, a_stream, a_task
from tests.policy.parsing import refused


def a_chain(levels):
    """t1 is the parent of t2, and so on."""
    return [*(a_parent(f"t{at}", f"t{at + 1}") for at in range(1, levels)), a_task(f"t{levels}")]


def test_a_graph_of_eight_levels_is_accepted():
    assert len(a_policy(tasks=a_chain(8)).tasks) == 8


GRAPHS = [
    pytest.param([a_parent("p", "nobody")], "spec.tasks[0].subtasks[0]", id="unknown"),
    pytest.param([a_parent("p", "p")], "spec.tasks[0]", id="itself"),
    pytest.param([a_parent("p", "q"), a_parent("q", "p")], "spec.tasks[0]", id="cycle"),
    pytest.param(a_chain(9), "spec.tasks[8]", id="too deep"),
    pytest.param([a_parent("p", "a"), a_parent("q", "a"), a_task("a")], "spec.tasks[0].subtasks[0]", id="two parents"),
    pytest.param([a_parent("p", "a", "a"), a_task("a")], "spec.tasks[0].subtasks[1]", id="the same twice"),
    pytest.param([a_parent("p", *"abcdefghijklmnopq")], "spec.tasks[0].subtasks", id="too many"),
    pytest.param([{"name": "p", "subtasks": [5]}], "spec.tasks[0].subtasks[0]", id="no name"),
]


@pytest.mark.parametrize(("tasks", "field"), GRAPHS)
def test_an_invalid_task_graph_is_refused(tasks, field):
    assert field in refused(tasks=tasks)


def needing(name, *required, **fields):
    return a_task(name, requires=[{"task": other} for other in required], **fields)


def reading(name, stream):
    return a_task(name, requires=[{"when": f"{stream}.done"}])


CYCLES = [
    pytest.param([needing("a", "b"), needing("b", "c"), needing("c", "a")], {}, "a -> b -> c -> a", id="tasks"),
    pytest.param([reading("a", "x"), reading("b", "y")], {"x": "b", "y": "a"}, "a -> b -> a", id="streams"),
    pytest.param([reading("a", "x")], {"x": "a"}, "a -> a", id="its own stream"),
    pytest.param([a_parent("p", "a"), needing("a", "p")], {}, "p -> a -> p", id="its parent"),
    pytest.param([a_parent("p", "a", "b"), a_task("a"), reading("b", "x")], {"x": "a"}, "p -> b -> p", id="compound"),
    pytest.param(
        [a_parent("p", "a"), a_task("a"), a_parent("q", "b"), needing("b", "a"), needing("c", "b")],
        {},
        None,
        id="none",
    ),
    pytest.param(
        [a_parent("p", "a", "b", satisfiedBy="Any"), a_task("a"), reading("b", "x")], {"x": "a"}, None, id="complex"
    ),
    pytest.param([a_parent("p", "a", "b"), a_task("a"), needing("b", "a")], {}, None, id="siblings"),
]


@pytest.mark.parametrize(("tasks", "producers", "cycle"), CYCLES)
def test_tasks_that_wait_for_each_other_are_refused_and_named(tasks, producers, cycle):
    streams = [a_stream(name, producedBy=task) for name, task in producers.items()]
    try:
        a_policy(streams=streams, tasks=tasks)
        found = []
    except PolicyError as error:
        found = [finding.value for finding in error.findings]
    assert (cycle in found) if cycle else not found


def test_a_cycle_says_why_each_task_waits():
    with pytest.raises(PolicyError) as caught:
        a_policy(streams=[a_stream("x", producedBy="b")], tasks=[reading("a", "x"), needing("b", "a")])
    assert str(caught.value.findings[0]).endswith(
        "no cycle in the task graph: a waits for b (it requires stream x of b), b waits for a (it requires task a)"
    )
