"""What the answers of the API server make of a candidacy; no thread runs here."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import Mock

import pytest

from contextpolicy.cluster import lease_keeper
from contextpolicy.cluster.lease import ACT, REFUSED, Candidacy, Lease
from contextpolicy.cluster.lease_keeper import LeaseKeeper
from contextpolicy.errors import ActuationError

TERMINATING = "unable to create new content in namespace lab because it is being terminated"


class Api:
    """One Lease, and what to answer to a write instead of taking it."""

    def __init__(self):
        self.there, self.refusals, self.written = Lease(), [], []

    def lease(self, namespace, name):
        assert (namespace, name) == ("lab", "contextpolicy")
        return self.there

    def write_lease(self, namespace, name, content, timeout):
        assert (namespace, name) == ("lab", "contextpolicy")
        assert timeout > 0
        self.written.append(content)
        if self.refusals:
            raise self.refusals.pop(0)
        self.there = replace(content, version=str(len(self.written)))
        return self.there


@pytest.fixture
def now(monkeypatch):
    time = [100.0]
    monkeypatch.setattr(lease_keeper, "clock", lambda: time[0])
    return time


@pytest.fixture
def api():
    return Api()


@pytest.fixture
def step(api, now):
    """Let a candidacy do what it is due to do."""
    keeper = LeaseKeeper(api, "contextpolicy", Mock())

    def one(candidacy):
        assert candidacy.due <= now[0]
        keeper._step("lab", candidacy)

    return one


def test_lease_is_read_then_taken(api, step):
    candidacy = Candidacy("one", 10)
    step(candidacy)
    assert api.written == []
    step(candidacy)
    assert candidacy.held
    assert candidacy.acts_until == 100 + ACT * 10


def test_lost_race_shows_the_new_holder(api, step):
    candidacy = Candidacy("one", 10)
    step(candidacy)
    api.there = Lease("other", 15, "now", "now", 1, "7")
    api.refusals.append(ActuationError("Conflict", "changed", retriable=True))
    step(candidacy)
    assert (candidacy.held, candidacy.holder, candidacy.due) == (False, "other", 115)


def test_forbidden_lease_is_reported_and_retried_rarely(api, step):
    candidacy = Candidacy("one", 10)
    step(candidacy)
    api.refusals.append(ActuationError("Forbidden", "no", retriable=False))
    step(candidacy)
    assert (candidacy.held, candidacy.refused, candidacy.due) == (False, "Forbidden: no", 100 + REFUSED)


def test_exception_is_a_logged_failure(api, step, caplog):
    candidacy = Candidacy("one", 10)
    step(candidacy)
    api.refusals.append(RuntimeError("unforeseen"))
    step(candidacy)
    assert not candidacy.held
    assert "internal error" in caplog.text


def test_terminating_namespace_still_releases_policies(api, step, now):
    """Nobody can create a Lease there any more; without one the policies would hold the namespace for ever."""
    candidacy = Candidacy("one", 10)
    step(candidacy)
    api.refusals += [ActuationError("Forbidden", TERMINATING, retriable=False)] * 2
    step(candidacy)
    assert (candidacy.held, candidacy.acts_until) == (True, 100 + ACT * 10)
    now[0] = candidacy.due
    step(candidacy)
    assert candidacy.acts_until == now[0] + ACT * 10


def an_object(version, uid):
    spec = {"holderIdentity": "other", "leaseDurationSeconds": 15, "renewTime": "now"}
    return {"metadata": {"resourceVersion": version, "uid": uid}, "spec": spec}


@pytest.mark.parametrize(("gone", "lost"), [("uid-before", False), ("uid-own", True)])
def test_only_the_lease_that_is_held_is_lost_with_its_object(api, gone, lost):
    """The watch may report late that the one before it was deleted, with the pod of its holder."""
    keeper, candidacy = LeaseKeeper(api, "contextpolicy", Mock(), watched="lab"), Candidacy("one", 10)
    keeper.stand("lab", candidacy)
    keeper.on_object(an_object("5", "uid-before"))
    candidacy.succeed(Lease("one", 10, "now", "now", 1, "7", uid="uid-own"), 100, 100)
    keeper.on_gone(gone)
    assert (candidacy.lost, candidacy.held) == (lost, not lost)


@pytest.mark.parametrize(("given_back", "acts"), [(False, False), (True, True)])
def test_terminating_namespace_is_left_to_the_release_that_held_its_lease(api, step, now, given_back, acts):
    """Each took the refusal for its Lease: two operators acted there."""
    candidacy = Candidacy("one", 10)
    api.there = Lease("other", 15, "now", "now", 1, "7")
    step(candidacy)
    now[0] = candidacy.due
    if given_back:
        api.there = replace(api.there, holder="", seconds=1, version="8")
        api.refusals.append(ActuationError("Conflict", "changed", retriable=True))
        step(candidacy)
        now[0] = candidacy.due
    api.there = Lease()
    api.refusals += [
        ActuationError("NotFound", "no such Lease", retriable=False),
        *[ActuationError("Forbidden", TERMINATING, retriable=False)] * 3,
    ]
    for _ in range(4):
        step(candidacy)
        now[0] = max(now[0], candidacy.due)
    assert candidacy.held is acts
    assert candidacy.refused == ("" if acts else "it is being deleted, and other serves it until then")


def test_a_pause_counts_also_where_the_namespace_is_being_deleted(api, now):
    keeper, candidacy = LeaseKeeper(api, "contextpolicy", Mock()), Candidacy("one", 10)
    for _ in range(2):
        keeper._step("lab", candidacy)
    assert keeper.interruptions == 0
    for refusals in ([], [ActuationError("Forbidden", TERMINATING, retriable=False)]):
        now[0] += 100
        api.refusals += refusals
        keeper._step("lab", candidacy)
    assert keeper.interruptions == 2


def test_left_namespace_frees_its_lease(api, step):
    keeper = LeaseKeeper(api, "contextpolicy", Mock())
    candidacy = Candidacy("one", 10)
    keeper.stand("lab", candidacy)
    step(candidacy)
    step(candidacy)
    keeper.leave("lab")
    assert (api.there.holder, candidacy.held) == ("", False)
