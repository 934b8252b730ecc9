"""What the doctor reads, and of which namespaces."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest

from contextpolicy.bus.issuing import found_authority, pem
from contextpolicy.cluster.api import ApiServer, Secret
from contextpolicy.cluster.paging import Page
from contextpolicy.cluster.serving import Service
from contextpolicy.commands.doctor import facts
from contextpolicy.errors import ActuationError
from tests.cluster.builders import a_pod

EVERYWHERE = [{"metadata": {"name": "one", "namespace": "lab"}}, {"metadata": {"name": "two", "namespace": "hall"}}]


class FakeApi(ApiServer):
    """An API server without pods and nodes, which says what it was asked, and allows nothing."""

    def __init__(self, forbidden=(), operators=()):
        self._forbidden, self._operators = forbidden, operators
        self.reviewed: set[str | None] = set()

    def serves_policies(self):
        return True

    def policies(self, namespace):
        if namespace in self._forbidden:
            raise ActuationError("Forbidden", "no", retriable=False)
        return [one for one in EVERYWHERE if namespace in (None, one["metadata"]["namespace"])]

    def read(self, path, *_):
        if path == "/version":
            return {"gitVersion": "v1.36.3"}
        return {}

    def read_page(self, path, _):
        if "/namespaces/lab/pods" in path:
            return Page({"items": [a_pod("slam"), {"metadata": {}}]}, 1)
        return Page({"items": self._operators if "component%3Doperator" in path else []}, 1)

    def service(self, namespace):
        return Service(served=namespace == "lab")

    def may(self, user, right):
        assert user == "system:serviceaccount:system:default"
        self.reviewed.add(right.get("namespace"))
        return False


def an_operator(watched):
    env = [{"name": "LEASE", "valueFrom": {}}, {"name": "WATCH_NAMESPACES", "value": watched}]
    return {"metadata": {"name": "operator", "namespace": "system"}, "spec": {"containers": [{"env": env}]}}


@pytest.mark.parametrize(
    ("namespaces", "judged"), [([None], ["one", "two"]), (["lab"], ["one"]), (["hall", "lab"], ["two", "one"])]
)
def test_doctor_reads_policies_of_the_requested_namespaces(namespaces, judged):
    found = facts(FakeApi(), namespaces).policies
    assert found is not None
    assert [policy["metadata"]["name"] for policy in found] == judged


def test_doctor_checks_whether_namespaces_are_served():
    assert facts(FakeApi(), [None]).services == {"lab": Service(served=True), "hall": Service(served=False)}


def test_pods_that_cannot_be_read_are_left_out():
    pods = facts(FakeApi(), [None]).pods
    assert pods is not None
    assert [pod.name for pod in pods] == ["slam"]


def test_policies_that_may_not_be_listed_are_unknown_and_not_missing():
    found = facts(FakeApi(forbidden=[None]), [None])
    assert (found.policies, found.serves_policies) == (None, True)


def disguised(**status):
    """A tenant's pod with an operator's labels."""
    pod = an_operator("")
    pod["metadata"]["namespace"] = "lab"
    return pod | {"status": status}


class ReviewingApi(FakeApi):
    """Allows the accounts in its namespace everything, and others nothing; a question may be refused."""

    def __init__(self, *pods, refused=False):
        super().__init__(operators=pods)
        self._refused = refused

    def may(self, user, _right):
        if self._refused:
            raise ActuationError("Forbidden", "no", retriable=False)
        return user.startswith("system:serviceaccount:system:")


@pytest.mark.parametrize("order", [1, -1])
def test_a_tenants_pod_with_an_operators_labels_is_not_judged(order):
    """It is not ready, has no rights, and mounts a certificate that has ended: BAD for every `helm test`."""
    real, fake = an_operator(""), disguised(phase="Pending")
    found = facts(ReviewingApi(*[real, fake][::order]), [None])
    assert found.operators == [real]
    assert found.lacking == []


def test_all_pods_with_an_operators_labels_are_judged_where_accounts_look_alike():
    real, fake = an_operator(""), disguised(phase="Pending")
    assert facts(ReviewingApi(real, fake, refused=True), [None]).operators == [real, fake]
    other = disguised()
    other["metadata"]["namespace"] = "hall"
    assert facts(ReviewingApi(fake, other), [None]).operators == [fake, other], "none may: this is what is wrong"


@pytest.mark.parametrize(
    ("watched", "of_policies", "reviewed"),
    [("lab,dock", [None], {"lab", "dock"}), ("", [None], {"lab", "hall"}), ("", ["dock"], {"system"})],
)
def test_the_operator_needs_its_rights_where_it_serves_policies(watched, of_policies, reviewed):
    api = FakeApi(operators=[an_operator(watched)])
    lacking = facts(api, of_policies).lacking
    assert lacking is not None
    assert "list pods in " + min(reviewed) in lacking
    assert api.reviewed == {*reviewed, None}


def test_doctor_reads_the_expiry_of_mounted_certificates():
    made = found_authority("ctxp", datetime(2026, 11, 24, tzinfo=UTC))

    class Api(FakeApi):
        def secret(self, _, name):
            if name == "theirs":
                raise ActuationError("Forbidden", "no", retriable=False)
            issued = made.issue("operator", (), made.certificate.not_valid_after_utc)
            return Secret({**issued, "ca.crt": pem([made.certificate])}, "1")

    operators = [an_operator(""), an_operator("")]
    for operator, name in zip(operators, ("ours", "theirs"), strict=True):
        operator["spec"]["volumes"] = [{"name": "bus", "secret": {"secretName": name}}, {"name": "other"}]
    ends = facts(Api(operators=operators), [None]).ends
    assert ends == {"system/ours": made.certificate.not_valid_after_utc, "system/theirs": None}
