"""Warnings about pods and their controllers in the files beside a policy."""

from __future__ import annotations

from typing import Any

import pytest
import yaml

from contextpolicy.policy.validation.check import check
from contextpolicy.policy.validation.problem import Severity
from contextpolicy.policy.validation.workloads import workloads
from tests.planning.builders import a_body, a_context, a_stream, a_task

PROBE = {"exec": {"command": ["true"]}}
TEMPLATE: dict[str, Any] = {
    "metadata": {"labels": {"app": "slam"}},
    "spec": {"containers": [{"name": "slam", "livenessProbe": PROBE}, {"name": "log"}]},
}
HALTED = a_context("halted", "true", {"slam": {"suspend": True}})


def a_workload(kind="Deployment", namespace="lab", template=TEMPLATE):
    spec = {"template": template} if kind != "CronJob" else {"jobTemplate": {"spec": {"template": template}}}
    return {"kind": kind, "metadata": {"name": "front", "namespace": namespace}, "spec": spec}


def a_bare_pod():
    metadata = {"name": "front", "namespace": "lab", **TEMPLATE["metadata"]}
    return {"kind": "Pod", "metadata": metadata, "spec": TEMPLATE["spec"]}


def written(*tasks, contexts=(HALTED,)):
    body = a_body(streams=[a_stream("imu")], tasks=list(tasks), contexts=list(contexts))
    return {"apiVersion": "contextpolicy.dev/v1alpha1", "kind": "ContextPolicy", **body}


def warnings(*files):
    """Those about probes."""
    texts = [(f"{number}.yaml", yaml.safe_dump_all(bodies)) for number, bodies in enumerate(files)]
    report = check(texts)
    assert report.errors == []
    return [problem for problem in report.problems if "livenessProbe" in problem.message]


def warned(*objects, **more):
    """`more` is the task's and the policy's."""
    contexts = more.pop("contexts", [HALTED])
    return warnings([written(a_task("slam", **more), contexts=contexts)], objects)


@pytest.mark.parametrize(
    "workload",
    [
        *map(a_workload, ["Deployment", "StatefulSet", "DaemonSet", "ReplicaSet", "Job", "CronJob"]),
        a_bare_pod(),
        {"kind": "List", "items": [a_workload()]},
    ],
    ids=lambda workload: workload["kind"],
)
def test_a_probe_of_a_task_that_may_be_suspended_is_warned_of(workload):
    [problem] = warned(workload)
    assert (problem.severity, problem.field, problem.file) == (Severity.WARNING, "spec.tasks[0]", "0.yaml")
    assert problem.message.startswith("front/slam has a livenessProbe and only 10m while it is suspended")
    assert "set suspendedCpu of the task" in problem.message


def test_tasks_without_the_probe_or_suspension_are_not():
    bare = {**TEMPLATE, "spec": {"containers": [{"name": "slam"}, {"name": "log", "livenessProbe": PROBE}]}}
    assert warned(a_workload(template=bare)) == []
    assert warned(a_workload(namespace="elsewhere")) == []
    assert warned(a_workload(template={**TEMPLATE, "metadata": {"labels": {"app": "map"}}})) == []
    assert warned(a_workload(), suspendedCpu="50m") == []
    assert warned(a_workload(), contexts=[]) == []


def test_a_workload_in_the_policys_file_is_checked_too():
    assert len(warnings([a_workload(), written(a_task("slam"))])) == 1


@pytest.mark.parametrize(
    "body",
    [
        None,
        [],
        "Pod",
        {"kind": ["Pod"]},
        {"kind": "Pod"},
        {"items": [None]},
        {"kind": "Pod", "spec": 1, "metadata": []},
    ],
)
def test_objects_without_pods_are_left_out(body):
    assert list(workloads(body)) == []


def test_an_incomplete_workload_is_tolerated():
    [odd] = workloads(
        {"kind": "Pod", "metadata": {"labels": {"app": [1]}}, "spec": {"containers": [None, {"name": 1}]}}
    )
    assert (odd.namespace, odd.probed) == ("default", frozenset())
