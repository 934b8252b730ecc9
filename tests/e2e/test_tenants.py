"""Namespaces that share a node: nobody takes what is another's, and streams are read where the administrator says."""

import json

import pytest

from tests.e2e.cluster import CommandError, apply, delete, run, until
from tests.e2e.robot import IDLE, Robot, pod, policy, task

TINY = {"requests": {"cpu": "10m", "memory": "32Mi"}, "limits": {"cpu": "10m", "memory": "64Mi"}}
RULE = "e2e-tenants-streams"


@pytest.fixture
def neighbour(empty, session):  # noqa: ARG001 - the operator must serve both namespaces
    """Another namespace's robot, with a policy that is older than all others, reserves nothing and has a tiny pod."""
    other = Robot("e2e-robot", empty.sensors)
    apply(
        pod("tiny", other.namespace, IDLE, TINY),
        policy(other.namespace, "tiny", reserve="0", tasks=[task("tiny")], contexts=[]),
    )
    run("kubectl", "wait", "pod/tiny", "-n", other.namespace, "--for=condition=Ready", "--timeout=60s")
    until("the tiny one is governed", lambda: other.condition("Accepted", "tiny")[0] == "True")
    yield other
    delete("ctxp", "tiny", other.namespace)
    other.stop("tiny")


def test_a_tiny_pod_in_another_namespace_leaves_the_robot_its_own(empty, neighbour):
    """The robot's pods have limits of 500m each; without a priority it divides these, and the neighbour its 10m."""
    empty.start("slam", "speech")
    empty.policy()
    empty.drive(0.3)
    empty.expect(slam=990, speech=10)
    until("its policy is accepted", lambda: empty.condition("Accepted")[0] == "True")
    assert neighbour.limits("tiny") == {"tiny": 10}


@pytest.fixture
def greedy(empty, session):  # noqa: ARG001 - the operator must serve both namespaces
    """Another namespace's idle pod that claims to be able to use a hundred cores."""
    other = Robot("e2e-robot", empty.sensors)
    huge = {"requests": {"cpu": "10m", "memory": "32Mi"}, "limits": {"cpu": "100", "memory": "64Mi"}}
    apply(
        pod("idle", other.namespace, IDLE, huge),
        policy(other.namespace, "idle", reserve="0", tasks=[task("idle")], contexts=[]),
    )
    run("kubectl", "wait", "pod/idle", "-n", other.namespace, "--for=condition=Ready", "--timeout=60s")
    until("the idle one is governed", lambda: other.condition("Accepted", "idle")[0] == "True")
    yield other
    delete("ctxp", "idle", other.namespace)
    other.stop("idle")


def test_an_idle_pod_with_a_huge_limit_takes_no_more_than_its_request_is_worth(empty, greedy):  # noqa: ARG001
    """On two cores an equal part would be 1000m, less than the 1400m that the robot's pods have without any policy."""
    wanted = {"requests": {"cpu": "100m", "memory": "32Mi"}, "limits": {"cpu": "700m", "memory": "64Mi"}}
    empty.start("slam", "speech", resources=wanted)
    empty.policy(reserve="0")
    empty.drive(0.3)
    until("its policy is accepted", lambda: empty.condition("Accepted")[0] == "True")
    until("it divides its own limits", lambda: empty.status()["nodes"][0]["capacity"] in ("1400m", "1.4"))


@pytest.fixture
def restricted(empty):
    """The chart's rule as an administrator would install it, for the robot's namespace."""
    tenants = {empty.namespace: {"streamPrefixes": [empty.namespace]}}
    rendered = run(
        *("helm", "template", "e2e-tenants", "charts/contextpolicy", "--show-only", "templates/admission.yaml"),
        *("--set", "fullnameOverride=e2e-tenants", "--set", f"watchNamespaces={{{empty.namespace}}}"),
        *("--set-json", f"tenants={json.dumps(tenants)}"),
    )
    run("kubectl", "apply", "-f", "-", stdin=rendered)
    until("the API server refuses", lambda: RULE in refusal(empty, "**"))
    yield empty
    run("kubectl", "delete", "-f", "-", stdin=rendered)


def refusal(robot, key):
    """What the API server says to a policy with this stream; empty when it takes it."""
    body = policy(robot.namespace, "probe", streams=[{"name": "imu", "key": key}], mode="DryRun")
    try:
        run("kubectl", "apply", "--dry-run=server", "-f", "-", stdin=json.dumps(body))
    except CommandError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("key", ["**", "*/imu", "other/imu", "e2e-pods2/imu"])
def test_a_stream_beyond_the_namespaces_prefixes_is_refused_at_once(restricted, key):
    expected = "a key that the administrator lets namespace e2e-pods read: e2e-pods/**"
    assert f"spec.streams: invalid value {key}: expected {expected}" in refusal(restricted, key)


def test_streams_below_the_prefix_are_taken(restricted):
    assert refusal(restricted, "e2e-pods/**") == ""
    restricted.start("slam")
    restricted.policy(tasks=[task("slam")], contexts=[])
    restricted.expect(slam=1000)
