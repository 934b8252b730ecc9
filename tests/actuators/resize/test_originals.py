"""What containers had before: which write is missing, and when it is certain that it is stored."""

from __future__ import annotations

import pytest

from contextpolicy.actuators.resize.originals import Original, Originals
from contextpolicy.cluster.pods import Cpu

POLICY, OTHER = "lab/robot", "lab/other"
BEFORE, LATER = Cpu(100, 500), Cpu(None, 700)
STORED = {"uid": {"pod": "slam", "containers": {"slam": {"request": "100m", "limit": "500m"}}}}


@pytest.fixture
def originals():
    return Originals()


def store(originals, policy=POLICY):
    originals.send(policy)
    originals.succeed(policy)


def note(originals, policy=POLICY, cpu=BEFORE, name="slam"):
    originals.note(policy, "uid", "slam", name, cpu)


def test_a_note_is_what_is_missing_until_it_is_stored(originals):
    note(originals)
    assert originals.changes(POLICY) == STORED
    assert not originals.is_stored(POLICY, "uid", "slam")
    originals.send(POLICY)
    assert originals.changes(POLICY) == {}, "it is under way"
    originals.succeed(POLICY)
    assert originals.changes(POLICY) == {}
    assert originals.is_stored(POLICY, "uid", "slam")


def test_the_first_note_counts(originals):
    note(originals)
    note(originals, cpu=LATER)
    assert originals.at("uid", "slam") == Original(POLICY, BEFORE)


def test_what_is_dropped_is_taken_out(originals):
    note(originals)
    note(originals, name="map")
    store(originals)
    originals.drop("uid", "map")
    assert originals.changes(POLICY)["uid"]["containers"]["map"] is None
    store(originals)
    originals.drop("uid", "slam")
    assert originals.changes(POLICY) == {"uid": None}


def test_what_was_dropped_while_it_was_written_is_taken_out_afterwards(originals):
    note(originals)
    originals.send(POLICY)
    originals.drop("uid", "slam")
    originals.succeed(POLICY)
    assert originals.changes(POLICY) == {"uid": None}


def test_after_a_lost_answer_all_of_it_is_written_anew(originals):
    note(originals)
    originals.send(POLICY)
    originals.fail(POLICY)
    assert not originals.is_stored(POLICY, "uid", "slam")
    assert originals.changes(POLICY) == STORED
    originals.drop("uid", "slam")
    assert originals.changes(POLICY) == {"uid": None}, "the status may hold it"
    note(originals, name="map")
    assert originals.changes(POLICY)["uid"]["containers"].keys() == {"slam", "map"}


def test_what_changes_hands_stays_where_it_was_until_the_next_has_stored_it(originals):
    note(originals)
    store(originals)
    note(originals, OTHER, LATER)
    assert originals.at("uid", "slam") == Original(OTHER, BEFORE)
    assert originals.changes(POLICY) == {}
    assert originals.changes(OTHER) == STORED
    store(originals, OTHER)
    assert originals.changes(POLICY) == {"uid": None}


def test_what_went_through_several_hands_is_stored_somewhere_at_any_time(originals):
    note(originals)
    store(originals)
    for heir in (OTHER, "lab/third"):
        note(originals, heir, LATER)
    store(originals, OTHER)
    assert originals.changes(POLICY) == {}
    store(originals, "lab/third")
    assert originals.changes(POLICY) == {"uid": None}


def test_a_status_is_recalled_once(originals):
    originals.recall(POLICY, STORED, lambda _: True)
    assert originals.is_stored(POLICY, "uid", "slam")
    assert originals.changes(POLICY) == {}
    originals.drop("uid", "slam")
    originals.recall(POLICY, STORED, lambda _: True)
    assert originals.at("uid", "slam") is None


def test_what_two_statuses_hold_belongs_to_one(originals):
    for policy in (POLICY, OTHER):
        originals.recall(policy, STORED, lambda _: True)
    assert originals.at("uid", "slam") == Original(OTHER, BEFORE)
    assert originals.changes(POLICY) == {"uid": None}


def test_a_policy_that_is_gone_keeps_nothing(originals):
    note(originals)
    originals.forget(POLICY)
    assert (originals.in_pod("uid"), list(originals.of(POLICY)), originals.changes(POLICY)) == ({}, [], {})


def test_a_pod_that_is_gone_is_taken_out(originals):
    note(originals)
    store(originals)
    originals.drop_pod("uid")
    assert originals.changes(POLICY) == {"uid": None}
