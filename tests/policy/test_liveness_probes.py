"""Which tasks a liveness probe may kill."""

from __future__ import annotations

import pytest

from contextpolicy.cluster.pod_parsing import view
from tests.cluster.builders import NODE, a_pod
from tests.cluster.claiming import claim
from tests.planning.builders import a_context, a_parent, a_policy, a_task

HALTED = a_context("halted", "true", {"slam": {"suspend": True}})


def warned(*tasks, contexts=(HALTED,), probe=True):
    pod = a_pod("slam")
    if probe:
        pod["spec"]["containers"][0]["livenessProbe"] = {"exec": {"command": ["true"]}}
    policy = a_policy(tasks=list(tasks), contexts=list(contexts))
    return claim([policy], [view(pod)], {NODE: 2000})[policy.reference].warnings


@pytest.mark.parametrize(
    "tasks",
    [
        ([a_task("slam")]),
        ([a_task("slam", idle=0, activity=[{"when": "true", "score": 1}])]),
        ([a_task("slam", requires=[{"when": "true"}], protected=True)]),
        ([a_task("slam"), a_parent("top", "slam")]),
    ],
    ids=["by a context", "by its activity", "protected, but it waits for something", "with its parent"],
)
def test_a_probed_task_that_may_be_suspended_is_warned_of(tasks):
    [warning] = warned(*tasks, contexts=[HALTED] if len(tasks) == 1 and len(tasks[0]) == 2 else []).values()
    assert warning.startswith("slam/slam has a livenessProbe and only 10m while it is suspended")
    assert "set suspendedCpu" in warning


def test_tasks_without_the_probe_or_suspension_are_not():
    assert warned(a_task("slam"), probe=False) == {}
    assert warned(a_task("slam", suspendedCpu="50m")) == {}
    assert warned(a_task("slam", protected=True)) == {}
    assert warned(a_task("slam"), contexts=[]) == {}
