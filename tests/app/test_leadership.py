"""What a replica knows of the Leases that it runs for; no thread runs here."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import Mock

import pytest

from contextpolicy.app import leadership as app_leadership
from contextpolicy.app.leadership import Leadership
from contextpolicy.app.settings import Settings
from contextpolicy.cluster import lease_keeper
from contextpolicy.cluster.lease import Lease
from contextpolicy.cluster.lease_keeper import LeaseKeeper
from contextpolicy.errors import ActuationError


class Api:
    """The Leases of all namespaces."""

    def __init__(self):
        self.leases = {}
        self.contested = ""
        """The namespace where somebody changes the Lease before each of our writes."""

    def lease(self, namespace, name):
        return self.leases.get((namespace, name), Lease())

    def write_lease(self, namespace, name, content, timeout):
        assert timeout > 0
        if namespace == self.contested:
            raise ActuationError("Conflict", "the object has been modified", retriable=True)
        written = replace(content, version=str(int(content.version or 0) + 1))
        self.leases[namespace, name] = written
        return written

    def read_page(self, path, most):
        raise AssertionError(path, most)

    def watch(self, path, version):
        raise AssertionError(path, version)


@pytest.fixture
def now(monkeypatch):
    time = [100.0]
    for module in (app_leadership, lease_keeper):
        monkeypatch.setattr(module, "clock", lambda: time[0])
    monkeypatch.setattr(LeaseKeeper, "start", lambda _: None)
    return time


@pytest.fixture
def api():
    return Api()


@pytest.fixture
def leadership(api):
    return Leadership(api, Settings(identity="one", lease=("system", "release")), Mock())


def renew(leadership, *, times=1):
    """Let the candidacy of each namespace look or write."""
    for _ in range(times):
        for namespace, candidacy in leadership._claims.items():
            leadership._claiming._step(namespace, candidacy)


def test_interruptions_stay_counted_when_namespaces_leave_or_are_lost(leadership, now):
    leadership.serve(["attic", "lab"])
    renew(leadership, times=2)
    assert leadership.interruptions == 0
    now[0] += 100
    renew(leadership)
    assert leadership.interruptions == 2
    leadership.serve(["lab"])
    assert leadership.interruptions == 2
    leadership._claims["lab"].see(Lease("other", 30, "now", "now", 2, "99"), now[0])
    leadership.serve(["lab"])
    assert leadership.interruptions == 2
    leadership.serve(["lab", "attic"])
    renew(leadership, times=2)
    now[0] += 100
    renew(leadership)
    assert leadership.interruptions == 4


def test_reason_is_reported_again_when_an_unserved_namespace_returns(leadership, now, caplog):
    for namespaces in (["lab"], [], ["lab"]):
        leadership.serve(namespaces)
        for claim in leadership._claims.values():
            claim.fail(now[0], "no right")
        for _ in range(2):
            assert leadership.served == frozenset()
    assert caplog.messages == ["namespace lab can't be served: no right"] * 2


def test_a_late_renewal_of_the_releases_own_lease_counts_too(leadership, now):
    for _ in range(2):
        leadership._keeper._step("system", leadership._replica)
    assert (leadership.leads, leadership.interruptions) == (True, 0)
    now[0] += 100
    leadership._keeper._step("system", leadership._replica)
    assert leadership.interruptions == 1


@pytest.mark.usefixtures("now")
def test_a_lease_that_can_never_be_taken_keeps_no_other_namespace_from_being_served(leadership, api, caplog):
    """Anyone who may write Leases in one namespace can change it before each of our writes."""
    api.contested = "lab"
    leadership.serve(["lab", "robot"])
    renew(leadership, times=2)
    assert leadership.served is None  # it may be ours in a moment: kopf would start twice
    renew(leadership, times=4)
    for _ in range(2):
        assert leadership.served == {"robot"}
    assert caplog.messages == ["namespace lab can't be served: each attempt to take its Lease failed"]
    api.contested = ""
    renew(leadership)
    assert leadership.served == {"lab", "robot"}
