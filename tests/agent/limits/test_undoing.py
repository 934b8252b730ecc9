"""Limits are ahead of the resize, and are put back to what the containers had before any policy."""

from __future__ import annotations

import pytest

from tests.agent.builders import CHAT, POLICY
from tests.agent.limits.planned import OTHER, resize, write


def test_unconfirmed_limits_are_undone(tree, limits, slam, speech):
    limits.plan({slam: 800, speech: 10})
    limits.release(POLICY)
    for group in (slam, speech, slam.parent, speech.parent):
        assert tree.limit(group) == 500
    assert limits.ledger.entries == {}


@pytest.mark.parametrize("limit", [10, 900])
def test_confirmed_limits_are_undone_too(tree, limits, slam, journal, limit):
    limits.plan({slam: limit})
    resize(tree, limits, slam, limit)
    limits.release(POLICY)
    assert (tree.limit(slam), tree.limit(slam.parent)) == (500, max(500, limit))
    assert journal.read_text() == ""


def test_stopping_keeps_confirmed_limits_and_undoes_the_rest(tree, limits, slam, speech, journal):
    limits.plan({slam: 10, speech: 20}, original=400)
    resize(tree, limits, slam, 10)
    limits.release(POLICY, leave_agreed=True)
    assert (tree.limit(slam), tree.limit(speech)) == (10, 500)
    assert journal.read_text() == ""


def test_stopping_returns_to_the_last_confirmed_limit(tree, limits, slam):
    limits.plan({slam: 10})
    resize(tree, limits, slam, 10)
    limits.plan({slam: 300})
    limits.release(POLICY, leave_agreed=True)
    assert tree.limit(slam) == 10


def test_the_api_agreeing_to_the_original_leaves_nothing_to_undo(tree, limits, slam, journal):
    limits.plan({slam: 10})
    resize(tree, limits, slam, 10)
    limits.plan({slam: 500})
    resize(tree, limits, slam, 500)
    assert journal.read_text() == ""


def test_a_container_that_the_plan_no_longer_names_gets_its_original(tree, limits, slam, speech):
    limits.plan({slam: 10, speech: 20})
    resize(tree, limits, slam, 10)
    limits.plan({speech: 20})
    assert (tree.limit(slam), tree.limit(speech)) == (500, 20)


def test_policies_do_not_undo_each_other(tree, limits, slam, speech):
    limits.plan({slam: 800})
    limits.plan({speech: 10}, policy=OTHER)
    limits.release(OTHER)
    assert (tree.limit(slam), tree.limit(speech)) == (800, 500)


def test_a_container_taken_over_at_the_same_limit_is_undone_only_by_its_new_policy(tree, limits, slam):
    limits.plan({slam: 10})
    resize(tree, limits, slam, 10)
    limits.plan({slam: 10}, policy=OTHER)
    limits.release(POLICY)
    assert tree.limit(slam) == 10
    limits.release(OTHER)
    assert tree.limit(slam) == 500


def test_a_container_that_ended_is_forgotten(tree, limits, slam, speech):
    limits.plan({slam: 800, speech: 10})
    for path in (*slam.iterdir(), slam):
        path.unlink() if path.is_file() else path.rmdir()
    limits.plan({speech: 20})
    assert tree.limit(speech) == 20
    assert not any(path.is_relative_to(slam) for path in limits.ledger.entries)


def test_container_without_a_limit_is_restored_to_none(tree, limits):
    free = tree.container(CHAT, limit=None)
    limits.plan({free: 10}, [free], original=None)
    limits.release(POLICY)
    assert (tree.limit(free), tree.limit(free.parent)) == (None, None)


def test_pod_limit_is_restored_beside_an_unmanaged_container(tree, limits, slam):
    sidecar = tree.container(CHAT, limit=100, uid="uid-a")
    limits.plan({slam: 10})
    write(tree, limits, slam, 10)
    write(tree, limits, slam.parent, 110)
    limits.release(POLICY)
    assert (tree.limit(slam), tree.limit(sidecar), tree.limit(slam.parent)) == (500, 100, 600)


def test_repeated_writes_do_not_grow_the_journal(tree, limits, slam, journal):
    limits.plan({slam: 10})
    resize(tree, limits, slam, 10)
    before = journal.read_text()
    for _ in range(3):
        limits.plan({slam: 10})
        resize(tree, limits, slam, 10)
    assert journal.read_text() == before
