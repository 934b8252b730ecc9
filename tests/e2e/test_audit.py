"""What the operator asks of the API is what the chart grants, no more and no less, by the API server's own log."""

import pytest

from tests.e2e import audit
from tests.e2e.cluster import delete, until
from tests.e2e.conftest import ROBOTS, SYSTEM
from tests.node import access

pytestmark = pytest.mark.skipif(access.user_cluster() is not None, reason="reads the audit log of our own node")

OPERATOR = "e2e"
RENEWAL = ("coordination.k8s.io", "leases", "update")
REASONS = {
    ("", "pods", "get"): "only a resize whose answer was lost is looked up: test_faults",
    ("", "configmaps", "get"): "only policies with ROS types of their own read it: test_ros2",
    **{
        (group, kind, "get"): "only originals that are not signed are compared with it: test_forged_originals"
        for group, kind in (
            *(("apps", kind) for kind in ("replicasets", "statefulsets", "daemonsets")),
            ("batch", "jobs"),
        )
    },
    ("", "secrets", "get"): "once, when it starts, which may be before this story",
    ("", "secrets", "patch"): "once for each release: it makes the key of the originals",
    ("contextpolicy.dev", "contextpolicies/originals", "update"): "no API: its admission policy asks for it",
    ("coordination.k8s.io", "leases", "delete"): "naming an owner needs it where owners are guarded (OpenShift)",
}
"""Rights that this story does not need, and who does."""


@pytest.fixture(scope="module")
def asked(robot):
    """What the operator asked up to the end of a policy's life, and until it has renewed its Lease."""
    robot.policy()
    robot.expect(slam=500, speech=500)
    robot.drive(0.3)
    robot.expect(slam=990, speech=10)
    until("the policy is in force", lambda: robot.condition("Ready")[0] == "True")
    delete("ctxp", "robot", robot.namespace)
    robot.drive(0.0)
    until("the Lease was renewed", lambda: RENEWAL in {call.right for call in audit.calls(OPERATOR, SYSTEM)})
    return audit.calls(OPERATOR, SYSTEM)


@pytest.fixture(scope="module")
def granted(operator):  # noqa: ARG001 - it has to be installed
    return audit.rights(OPERATOR)


def test_nothing_was_refused(asked):
    assert asked
    assert [call for call in asked if call.decision != audit.ALLOWED] == []


def test_every_call_is_one_that_the_chart_grants(asked, granted):
    """Not one that the account has for another reason, as every account may ask what the API offers."""
    made = {(call.namespace, call.right) for call in asked}
    assert {(where, right) for where, right in made if not {(where, right), ("", right)} & granted} == set()


def test_every_right_is_used_or_has_a_reason(asked, granted):
    made = {call.right for call in asked}
    assert {right for _, right in granted} - made - REASONS.keys() == set()


def test_access_outside_its_namespaces_is_minimal(asked):
    elsewhere = {(call.namespace, call.right[1]) for call in asked if call.namespace not in ROBOTS}
    assert elsewhere <= {("", "nodes"), (SYSTEM, "leases"), (SYSTEM, "secrets")}
