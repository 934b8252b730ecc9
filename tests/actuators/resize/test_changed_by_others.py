"""Originals that somebody else changes while the operator runs: they are written again, whatever was done to them."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contextpolicy.actuators.resize.originals import Originals
from contextpolicy.actuators.resize.stored_originals import Signatures, StoredOriginals
from contextpolicy.cluster.pods import Cpu
from tests.actuators.resize.fake_cluster import UNREACHABLE, Unanswered, merged
from tests.actuators.resize.rig import MOMENT, POLICY, Rig
from tests.cluster.builders import a_pod

TRUE = {"uid-slam": {"pod": "slam", "containers": {"slam": {"request": "100m", "limit": "500m"}}}}
FORGERIES = {
    "emptied": {"uid-slam": None},
    "another limit": {"uid-slam": {"containers": {"slam": {"limit": "50m"}}}},
    "no limit": {"uid-slam": {"containers": {"slam": {"limit": None}}}},
    "no container": {"uid-slam": {"containers": {"slam": None}}},
    "a container more": {"uid-slam": {"containers": {"map": {"limit": "50m"}}}},
    "a pod more": {"uid-other": {"pod": "other", "containers": {"other": {"limit": "50m"}}}},
    "an agent": {"uid-slam": {"agent": True}},
    "another name": {"uid-slam": {"pod": "speech"}},
    "no entry": {"uid-slam": "nothing"},
}


def resized() -> Rig:
    rig = Rig(a_pod("slam"))
    rig.enforce(slam=300)
    rig.show()
    assert rig.cluster.policies == {POLICY: TRUE}
    return rig


@pytest.mark.parametrize("forgery", FORGERIES.values(), ids=FORGERIES)
def test_changed_originals_are_rewritten_at_once(forgery):
    rig = resized()
    rig.cluster.change_originals(POLICY, forgery)
    rig.show()
    assert rig.cluster.policies == {POLICY: TRUE}
    assert rig.witness.changed_by_others == [POLICY]
    rig.show()
    assert rig.witness.changed_by_others == [POLICY], "what is shown now is our own"


@pytest.mark.parametrize("forgery", FORGERIES.values(), ids=FORGERIES)
def test_deleted_policy_restores_the_true_originals(forgery):
    rig = resized()
    rig.cluster.change_originals(POLICY, forgery)
    rig.show()
    rig.kill()
    rig.release()
    rig.settle()
    assert (rig.cluster.limit("slam"), rig.released) == (500, [POLICY])


def test_no_resize_happens_before_the_originals_are_rewritten():
    rig = Rig(a_pod("slam"), stores=True)
    rig.enforce(slam=300)
    rig.cluster.change_originals(POLICY, {"uid-slam": None})
    rig.show()
    rig.plan(slam=200)
    assert [call for call, *_ in rig.cluster.calls].count("resize") == 1
    rig.settle()
    assert [call for call, *_ in rig.cluster.calls][-2:] == ["store", "resize"]
    assert rig.cluster.limit("slam") == 200


def test_stale_watch_event_is_not_a_foreign_change():
    rig = Rig(a_pod("slam"))
    rig.enforce(slam=300)
    calls = len(rig.cluster.calls)
    rig.resizer.inspect(POLICY, {}, 1)
    rig.wait(MOMENT)
    assert (len(rig.cluster.calls), rig.witness.changed_by_others) == (calls, [])


def test_foreign_change_during_our_write_is_detected():
    rig = Rig(a_pod("slam"), a_pod("speech"), stores=True)
    rig.enforce(slam=300)
    rig.plan(slam=300, speech=300)
    rig.workers.run()
    rig.cluster.change_originals(POLICY, {"uid-slam": None})
    rig.show()
    rig.settle()
    assert rig.cluster.policies[POLICY].keys() == {"uid-slam", "uid-speech"}
    assert rig.witness.changed_by_others == [POLICY]


def test_lost_answer_is_not_a_foreign_change():
    rig = Rig(a_pod("slam"), stores=True)
    rig.plan(slam=300)
    rig.cluster.faults.append(Unanswered(UNREACHABLE))
    rig.work()
    rig.show()
    rig.settle()
    assert (rig.cluster.policies, rig.witness.changed_by_others) == ({POLICY: TRUE}, [])


def test_originals_are_guarded_before_the_first_plan():
    rig = resized()
    rig.kill()
    rig.cluster.faults.append(UNREACHABLE)
    rig.cluster.change_originals(POLICY, {"uid-slam": None})
    rig.show()
    assert rig.cluster.policies == {POLICY: {}}
    rig.wait(10.0)
    assert rig.cluster.policies == {POLICY: TRUE}


NAMES = st.sampled_from(["slam", "map"])
UIDS = st.sampled_from(["uid-1", "uid-2"])
STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("note"), UIDS, NAMES),
        st.tuples(st.just("drop"), UIDS, NAMES),
        st.tuples(st.just("send")),
        st.tuples(st.just("arrive"), st.sampled_from(["answered", "lost", "refused"])),
        st.tuples(st.just("forge"), UIDS, st.sampled_from([None, {"containers": {"map": {"limit": "1"}}}, "x"])),
        st.tuples(st.just("show"), st.integers(0, 3)),
    ),
    max_size=25,
)


@settings(max_examples=300)
@given(STEPS)
def test_status_converges_to_the_noted_originals(steps):  # noqa: C901, PLR0912 - one line for each kind of step
    originals, sent = Originals(Signatures(b"k" * 32)), None
    history: list[dict[str, Any]] = [{}]
    originals.recall(POLICY, StoredOriginals(), lambda _: True)
    noted: set[tuple[str, str]] = set()
    for step, *how in steps:
        if step == "note":
            originals.note(POLICY, how[0], "pod", how[1], Cpu(100, 500))
            noted.add((how[0], how[1]))
        elif step == "drop" and tuple(how) in noted:
            originals.drop(*how)
            noted.discard((how[0], how[1]))
        elif step == "forge":
            history.append(merged(history[-1], {how[0]: how[1]}))
        elif step == "show":
            version = max(0, len(history) - 1 - how[0])
            originals.inspect(POLICY, history[version], version)
        elif step == "send" and sent is None:
            sent = originals.changes(POLICY) or None
            if sent is not None:
                originals.send(POLICY)
        elif step == "arrive" and sent is not None:
            if how[0] != "refused":
                history.append(merged(history[-1], sent))
            if how[0] == "answered":
                originals.succeed(POLICY, len(history) - 1)
            else:
                originals.fail(POLICY)
            sent = None
    if sent is not None:
        originals.fail(POLICY)
    for _ in range(3):
        originals.inspect(POLICY, history[-1], len(history) - 1)
        changes = originals.changes(POLICY)
        if changes:
            originals.send(POLICY)
            history.append(merged(history[-1], changes))
            originals.succeed(POLICY, len(history) - 1)
    held = {(uid, name) for uid, entry in history[-1].items() for name in entry["containers"]}
    assert held == noted
    assert all(originals.is_stored(POLICY, *one) for one in noted)


def test_a_policy_with_an_unproven_entry_is_released_only_when_the_pod_is_gone():
    """Its containers could not be put back: the user who deletes it sees why, and may let the right release do it."""
    rig = Rig(a_pod("slam"))
    rig.resizer.recall(
        POLICY,
        StoredOriginals(TRUE, 1, {}, {"uid-slam": "nobody can prove it"}),
    )
    rig.release()
    rig.settle()
    assert (rig.released, rig.witness.problems) == ([], [(POLICY, "slam", "Unproven")])
    rig.resizer.forget("uid-slam")
    rig.settle()
    assert rig.released == [POLICY]
