"""What containers had before: which write is missing, and when it is certain that it is stored."""

from __future__ import annotations

import pytest

from contextpolicy.actuators.resize.originals import Original, Originals
from contextpolicy.actuators.resize.stored_originals import UnsignedOriginals
from contextpolicy.cluster.pods import Cpu
from tests.actuators.resize.rig import believed

POLICY, OTHER = "lab/robot", "lab/other"
BEFORE, LATER = Cpu(100, 500), Cpu(None, 700)
STORED = {"uid": {"pod": "slam", "containers": {"slam": {"request": "100m", "limit": "500m"}}}}


@pytest.fixture
def originals():
    return Originals(UnsignedOriginals())


def store(originals, policy=POLICY):
    originals.send(policy)
    return originals.succeed(policy, 0)


def recall(originals, policy=POLICY):
    originals.recall(policy, believed({"metadata": {}, "status": {"originals": STORED}}), lambda _: True)


def note(originals, policy=POLICY, cpu=BEFORE, name="slam"):
    originals.note(policy, "uid", "slam", name, cpu)


def test_noted_original_is_pending_until_stored(originals):
    note(originals)
    assert originals.changes(POLICY) == STORED
    assert not originals.is_stored(POLICY, "uid", "slam")
    originals.send(POLICY)
    assert originals.changes(POLICY) == {}, "it is under way"
    originals.succeed(POLICY, 0)
    assert originals.changes(POLICY) == {}
    assert originals.is_stored(POLICY, "uid", "slam")


def test_the_first_note_counts(originals):
    note(originals)
    note(originals, cpu=LATER)
    assert originals.at("uid", "slam") == Original(POLICY, BEFORE)


def test_dropped_original_is_removed_from_the_status(originals):
    note(originals)
    note(originals, name="map")
    store(originals)
    originals.drop("uid", "map")
    assert originals.changes(POLICY)["uid"]["containers"]["map"] is None
    store(originals)
    originals.drop("uid", "slam")
    assert originals.changes(POLICY) == {"uid": None}


def test_original_dropped_during_its_write_is_removed_afterwards(originals):
    note(originals)
    originals.send(POLICY)
    originals.drop("uid", "slam")
    originals.succeed(POLICY, 0)
    assert originals.changes(POLICY) == {"uid": None}


def test_everything_is_rewritten_after_a_lost_answer(originals):
    note(originals)
    originals.send(POLICY)
    originals.fail(POLICY)
    assert not originals.is_stored(POLICY, "uid", "slam")
    assert originals.changes(POLICY) == STORED
    originals.drop("uid", "slam")
    assert originals.changes(POLICY) == {"uid": None}, "the status may hold it"
    note(originals, name="map")
    assert originals.changes(POLICY)["uid"]["containers"].keys() == {"slam", "map"}


def test_handed_over_original_stays_until_the_new_policy_stores_it(originals):
    note(originals)
    store(originals)
    note(originals, OTHER, LATER)
    assert originals.at("uid", "slam") == Original(OTHER, BEFORE)
    assert originals.changes(POLICY) == {}
    assert originals.changes(OTHER) == STORED
    store(originals, OTHER)
    assert originals.changes(POLICY) == {"uid": None}


def test_originals_survive_every_handover(originals):
    note(originals)
    store(originals)
    for heir in (OTHER, "lab/third"):
        note(originals, heir, LATER)
    store(originals, OTHER)
    assert originals.changes(POLICY) == {}
    store(originals, "lab/third")
    assert originals.changes(POLICY) == {"uid": None}


def test_a_status_is_recalled_once(originals):
    recall(originals)
    assert originals.is_stored(POLICY, "uid", "slam")
    assert originals.changes(POLICY) == {}
    originals.drop("uid", "slam")
    recall(originals)
    assert originals.at("uid", "slam") is None


def test_original_in_two_statuses_belongs_to_one_policy(originals):
    for policy in (POLICY, OTHER):
        recall(originals, policy)
    assert originals.at("uid", "slam") == Original(OTHER, BEFORE)
    assert originals.changes(POLICY) == {"uid": None}


def test_forgotten_policy_holds_no_originals(originals):
    note(originals)
    originals.forget(POLICY)
    assert (originals.in_pod("uid"), list(originals.of(POLICY)), originals.changes(POLICY)) == ({}, [], {})


def test_originals_of_a_deleted_pod_are_removed(originals):
    note(originals)
    store(originals)
    originals.drop_pod("uid")
    assert originals.changes(POLICY) == {"uid": None}


def test_an_agent_is_remembered_whether_it_came_before_the_first_note_or_after(originals):
    originals.attend("uid")
    note(originals)
    assert originals.changes(POLICY)["uid"]["agent"] is True
    late = Originals(UnsignedOriginals())
    note(late)
    store(late)
    late.attend("uid")
    assert late.changes(POLICY)["uid"]["agent"] is True


def test_the_agent_of_a_pod_that_is_gone_is_forgotten(originals):
    originals.attend("uid")
    originals.drop_pod("uid")
    note(originals)
    assert originals.changes(POLICY) == STORED


@pytest.mark.parametrize(
    "end",
    [
        pytest.param(lambda originals: originals.drop("uid", "slam"), id="restored"),
        pytest.param(lambda originals: originals.drop_pod("uid"), id="the pod is gone"),
        pytest.param(lambda originals: originals.forget(POLICY), id="the policy is gone"),
        pytest.param(lambda originals: originals.settle(POLICY, ["uid"]), id="taken care of"),
    ],
)
def test_an_inherited_agents_writes_are_forgotten_with_their_containers(originals, end):
    """As long as there is any, each pass looks at all containers of the policy."""
    stored = {"uid": {**STORED["uid"], "agent": True}}
    originals.recall(POLICY, believed({"metadata": {}, "status": {"originals": stored}}), lambda _: True)
    assert originals.inherited(POLICY) == {"uid"}
    end(originals)
    assert originals.inherited(POLICY) == frozenset()
