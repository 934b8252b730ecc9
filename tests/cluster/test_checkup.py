from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from contextpolicy.cluster.checkup import checkup
from contextpolicy.cluster.cluster_facts import ClusterFacts, Verdict
from contextpolicy.cluster.pod_parsing import view
from contextpolicy.cluster.serving import Service
from tests.cluster.builders import a_pod
from tests.planning.builders import a_body, a_task

NOW, DAY = datetime(2026, 11, 24, tzinfo=UTC), timedelta(days=1)
METRICS = "# HELP kubelet_cgroup_version x\nkubelet_cgroup_version 2\n"


def a_program(name, *, ready=True, restarts=0, of="contextpolicy", closed=True):
    return {
        "metadata": {
            "namespace": "contextpolicy-system",
            "name": name,
            "labels": {"app.kubernetes.io/instance": of},
        },
        "status": {
            "phase": "Running",
            "conditions": [{"type": "Ready", "status": str(ready)}],
            "containerStatuses": [{"restartCount": restarts}],
        },
        "spec": {"containers": [{"env": [{"name": "ZENOH_CREDENTIALS"}] if closed else []}]},
    }


def a_policy(**conditions):
    made = [
        {"type": kind, "status": "False", "reason": reason, "message": "do this"} for kind, reason in conditions.items()
    ]
    healthy = [] if conditions else [{"type": "Ready", "status": "True", "reason": "Working", "message": ""}]
    return {"metadata": {"namespace": "robot", "name": "delivery"}, "status": {"conditions": made + healthy}}


WELL = ClusterFacts(
    version="v1.36.3",
    policies=[a_policy()],
    operators=[a_program("operator")],
    routers=[a_program("router")],
    nodes=[{"metadata": {"name": "n1"}, "status": {"nodeInfo": {"kubeletVersion": "v1.36.3+k3s1"}}}],
    lacking=[],
    kubelets={"n1": ({"cgroupDriver": "systemd", "cpuManagerPolicy": "none"}, METRICS)},
    ends={"contextpolicy-system/contextpolicy-bus-operator": NOW + 31 * DAY},
    now=NOW,
)


def problems(**changes):
    return [check for check in checkup(replace(WELL, **changes)) if check.verdict != Verdict.OK]


def found(**changes):
    return {(check.subject, check.verdict.value) for check in problems(**changes)}


def test_a_cluster_on_which_all_is_well():
    assert {check.verdict for check in checkup(WELL)} == {Verdict.OK}
    assert "version 2, driver systemd" in {check.seen for check in checkup(WELL)}


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"version": "v1.32.9"}, ("API server", "bad")),
        ({"version": "v1.35.0"}, ("API server", "warning")),
        ({"version": "unknown"}, ("API server", "bad")),
        ({"policies": None}, ("ContextPolicy definition", "unknown")),
        ({"policies": None, "serves_policies": False}, ("ContextPolicy definition", "bad")),
        ({"operators": []}, ("operator", "bad")),
        ({"operators": None}, ("operator", "unknown")),
        ({"operators": [a_program("a", of="x"), a_program("b", of="y")]}, ("operator", "warning")),
        ({"operators": [a_program("a", ready=False)]}, ("operator contextpolicy-system/a", "bad")),
        ({"operators": [a_program("a", restarts=3)]}, ("operator contextpolicy-system/a", "warning")),
        ({"routers": [a_program("router", ready=False)]}, ("bus", "bad")),
        ({"routers": [a_program("r", closed=False)]}, ("router contextpolicy-system/r", "warning")),
        ({"ends": {"system/a": NOW + 29 * DAY}}, ("certificate in system/a", "warning")),
        ({"ends": {"system/a": NOW + 6 * DAY}}, ("certificate in system/a", "bad")),
        ({"ends": {"system/a": NOW - DAY}}, ("certificate in system/a", "bad")),
        ({"ends": {"system/a": None}}, ("certificate in system/a", "unknown")),
        ({"policies": [a_policy(StreamsHealthy="NoRouter")]}, ("bus", "bad")),
        ({"policies": [a_policy(Connected="Lost")]}, ("bus", "bad")),
        ({"lacking": ["patch pods/resize in robot"]}, ("operator's rights", "bad")),
        ({"lacking": None}, ("operator's rights", "unknown")),
        ({"nodes": None}, ("nodes", "unknown")),
        ({"kubelets": {}}, ("cgroups of n1", "unknown")),
        ({"kubelets": {"n1": ({"cpuCFSQuota": False}, METRICS)}}, ("cgroups of n1", "bad")),
        ({"kubelets": {"n1": ({"cpuManagerPolicy": "static"}, METRICS)}}, ("CPU manager of n1", "warning")),
        ({"policies": [a_policy(Accepted="Invalid")]}, ("policy robot/delivery", "bad")),
        ({"policies": [a_policy(Feasible="Unmet")]}, ("policy robot/delivery", "warning")),
        ({"policies": [{"metadata": {"namespace": "robot", "name": "delivery"}}]}, ("policy robot/delivery", "bad")),
    ],
)
def test_problems_are_found_with_a_remedy(changes, expected):
    assert expected in found(**changes)
    assert all(check.remedy for check in problems(**changes))


def test_missing_chart_router_is_not_a_problem():
    assert found(routers=[]) == set()


def test_a_task_that_its_liveness_probe_may_kill_is_named():
    pod = a_pod("slam")
    pod["spec"]["containers"][0]["livenessProbe"] = {"tcpSocket": {"port": 1}}
    policy = {**a_policy(), **a_body(tasks=[a_task("slam", requires=[{"when": "true"}])])}
    policy["status"] = a_policy()["status"]
    warning = ("task slam of policy lab/robot", "warning")
    assert found(policies=[policy], pods=[view(pod)]) == {warning}
    assert found(policies=[policy], pods=[view(a_pod("slam"))]) == set()
    assert found(policies=[policy], pods=None) == {("tasks", "unknown")}


def a_definition(name, namespace="system"):
    owner = {"meta.helm.sh/release-name": name, "meta.helm.sh/release-namespace": namespace}
    return {"metadata": {"name": "contextpolicies.contextpolicy.dev", "annotations": owner}}


def test_crd_of_another_release_is_reported():
    """Helm keeps it when a release is uninstalled, and refuses it to the next one of another name."""
    operator = a_program("operator")
    labels = {"app.kubernetes.io/instance": "second"}
    operator["metadata"] = {**operator["metadata"], "namespace": "system", "labels": labels}
    here = replace(WELL, operators=[operator])
    fine: list[dict[str, Any] | None] = [None, {}, {"metadata": {}}, a_definition("second")]
    for definition in fine:
        assert {check.verdict for check in checkup(replace(here, definition=definition))} == {Verdict.OK}
    for other in (a_definition("first"), a_definition("second", "elsewhere")):
        [check] = [one for one in checkup(replace(here, definition=other)) if one.verdict is not Verdict.OK]
        assert (check.subject, check.verdict) == ("ContextPolicy definition", Verdict.WARNING)
        assert "--take-ownership" in check.remedy


@pytest.mark.parametrize(
    ("served", "verdict", "seen"),
    [
        (True, "ok", "all conditions are True"),
        (False, "unknown", "all conditions were True while an operator served it"),
        (None, "unknown", "all conditions were True when last written"),
    ],
)
def test_conditions_are_those_of_an_operator_that_serves(served, verdict, seen):
    checks = {one.subject: one for one in checkup(replace(WELL, services={"robot": Service(served=served)}))}
    assert (checks["policy robot/delivery"].verdict, checks["policy robot/delivery"].seen) == (verdict, seen)
    of_namespace = {True: None, False: "bad", None: "unknown"}[served]
    assert ("namespace robot" in checks) is (of_namespace is not None)
    assert of_namespace is None or checks["namespace robot"].verdict == of_namespace


@pytest.mark.parametrize(
    ("deployments", "seen", "remedy"),
    [
        ([], "not installed", "helm install contextpolicy charts/contextpolicy"),
        (None, "no pod", "if `helm list -A` shows no release: helm install contextpolicy charts/contextpolicy"),
        (
            [{"metadata": {"namespace": "system", "name": "ctxp"}, "spec": {"replicas": 0}}],
            "no pod: Deployment system/ctxp wants 0 replicas",
            "kubectl scale -n system deployment/ctxp --replicas=1",
        ),
        (
            [{"metadata": {"namespace": "system", "name": "ctxp"}, "spec": {"replicas": 2}}],
            "no pod: Deployment system/ctxp wants 2 replicas",
            "kubectl describe -n system deployment/ctxp",
        ),
    ],
)
def test_remedy_for_a_missing_operator_fits_the_installation(deployments, seen, remedy):
    checks = {one.subject: one for one in checkup(replace(WELL, operators=[], lacking=None, deployments=deployments))}
    assert (checks["operator"].seen, checks["operator"].remedy) == (seen, remedy)
    rights = checks["operator's rights"]
    assert (rights.verdict, rights.remedy) == ("unknown", "start one, then run `doctor` again")
