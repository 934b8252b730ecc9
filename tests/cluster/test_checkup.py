from __future__ import annotations

from dataclasses import replace

import pytest

from contextpolicy.cluster.checkup import ClusterFacts, Verdict, checkup
from tests.cluster.builders import a_pod
from tests.planning.builders import a_body, a_task

METRICS = "# HELP kubelet_cgroup_version x\nkubelet_cgroup_version 2\n"


def a_program(name, *, ready=True, restarts=0, of="contextpolicy"):
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
)


def found(**changes):
    return {
        (check.subject, check.verdict.value)
        for check in checkup(replace(WELL, **changes))
        if check.verdict != Verdict.OK
    }


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
def test_what_is_wrong_is_found(changes, expected):
    assert expected in found(**changes)


def test_everything_that_is_bad_says_what_mends_it():
    worst = ClusterFacts(
        "v1.30.0", [a_policy(Applied="NotApplied")], [], [a_program("r", ready=False)], None, ["patch pods"]
    )
    assert all(check.remedy for check in checkup(worst) if check.verdict is not Verdict.OK)


def test_a_router_of_the_users_own_is_no_fault():
    assert found(routers=[]) == set()


def test_a_task_that_its_liveness_probe_may_kill_is_named():
    pod = a_pod("slam")
    pod["spec"]["containers"][0]["livenessProbe"] = {"tcpSocket": {"port": 1}}
    policy = {**a_policy(), **a_body(tasks=[a_task("slam", requires=[{"when": "true"}])])}
    policy["status"] = a_policy()["status"]
    warning = ("task slam of policy lab/robot", "warning")
    assert found(policies=[policy], pods=[pod]) == {warning}
    assert found(policies=[policy], pods=[a_pod("slam"), {"metadata": {}}]) == set()
    assert found(policies=[policy], pods=None) == {("tasks", "unknown")}
