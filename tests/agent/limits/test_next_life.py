"""After a kill the next life knows what to undo, what was confirmed, and what systemd rounded."""

from __future__ import annotations

import pytest

from tests.agent.builders import POLICY
from tests.agent.limits.planned import OTHER, resize, write


def test_the_next_life_undoes_what_the_api_had_before_the_first_was_killed(tree, limits, live, slam):
    limits.plan({slam: 10})
    resize(tree, limits, slam, 10)
    live().release(POLICY)
    assert (tree.limit(slam), tree.limit(slam.parent)) == (500, 500)


def test_a_life_that_finds_the_plan_in_force_can_undo_it(tree, live, slam):
    tree.set(slam, 10)
    tree.set(slam.parent, 10)
    live().plan({slam: 10})
    live().release(POLICY)
    assert (tree.limit(slam), tree.limit(slam.parent)) == (500, 500)


def test_after_a_kill_the_same_plan_continues_unconfirmed(tree, limits, live, slam):
    limits.plan({slam: 800})
    heir = live()
    heir.plan({slam: 800})
    assert tree.limit(slam) == 800
    heir.release(POLICY, leave_agreed=True)
    assert (tree.limit(slam), tree.limit(slam.parent)) == (500, 500)


def test_after_a_kill_the_plan_shows_what_was_confirmed_meanwhile(tree, limits, live, slam):
    limits.plan({slam: 800})
    heir = live()
    heir.settle(slam, 800)
    heir.plan({slam: 800})
    heir.release(POLICY, leave_agreed=True)
    assert tree.limit(slam) == 800


@pytest.mark.parametrize("confirmed", [False, True])
@pytest.mark.parametrize("leave_agreed", [False, True])
def test_an_owners_decision_while_no_agent_lived_is_not_undone(tree, live, slam, confirmed, leave_agreed):
    limits = live()
    limits.plan({slam: 10})
    if confirmed:
        resize(tree, limits, slam, 10)
    tree.set(slam, 300)
    live().release(POLICY, leave_agreed=leave_agreed)
    assert tree.limit(slam) == 300


def test_an_external_write_to_an_earlier_agents_file_is_journaled(tree, limits, live, slam):
    limits.plan({slam: 800}, {slam})
    heir, file = live(), tree.limit_file(slam)
    write(tree, heir, slam, 300)
    assert live().ledger.entries[file].theirs == heir.ledger.entries[file].theirs
    assert tree.limit(slam) == 300


@pytest.fixture
def shared(tree):
    """Two containers of one pod."""
    return [tree.container(identity * 64, uid="uid-x", limit=250) for identity in "12"]


def test_a_pod_of_a_deleted_policy_keeps_what_another_policys_container_needs(tree, limits, shared):
    for policy, group in zip((POLICY, OTHER), shared, strict=True):
        limits.plan({group: 1000}, policy=policy, original=250)
    limits.release(OTHER)
    write(tree, limits, shared[0].parent, 500)
    assert tree.limit(shared[0].parent) == 1250


def test_a_pod_that_only_an_earlier_run_wrote_is_kept_for_another_policy(tree, limits, live, shared):
    limits.plan({shared[0]: 1000}, original=250)
    heir = live()
    assert heir.ledger.entries.keys() == limits.ledger.entries.keys()
    heir.plan({shared[1]: 200}, policy=OTHER, original=250)
    write(tree, heir, shared[0].parent, 500)
    assert tree.limit(shared[0].parent) == 1200


@pytest.mark.parametrize("killed", [False, True])
def test_an_earlier_limit_of_ours_is_not_taken_for_a_rounded_one(tree, limits, live, slam, killed):
    limits.plan({slam: 20})
    (live() if killed else limits).plan({slam: 15})
    assert tree.limit(slam) == 15


def test_an_earlier_limit_that_the_api_has_confirmed_is_none_either(tree, limits, slam):
    limits.plan({slam: 20})
    write(tree, limits, slam, 20)
    limits.plan({slam: 15})
    assert tree.limit(slam) == 15


def test_our_limit_that_systemd_has_rounded_is_left_as_it_is(tree, limits, slam):
    limits.plan({slam: 15})
    write(tree, limits, slam, 20)
    limits.plan({slam: 15})
    assert tree.limit(slam) == 20
