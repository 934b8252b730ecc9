"""After a kill the next life knows what to undo, what was confirmed, and what systemd rounded."""

from __future__ import annotations

import pytest

from tests.agent.builders import POLICY
from tests.agent.limits.planned import OTHER, resize, write


def test_restarted_agent_undoes_limits_confirmed_before_the_kill(tree, limits, live, slam):
    limits.plan({slam: 10})
    resize(tree, limits, slam, 10)
    live().release(POLICY)
    assert (tree.limit(slam), tree.limit(slam.parent)) == (500, 500)


def test_restarted_agent_can_undo_a_plan_already_in_force(tree, live, slam):
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
def test_external_limit_set_while_no_agent_ran_is_kept(tree, live, slam, confirmed, leave_agreed):
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
def test_own_earlier_limit_is_not_mistaken_for_rounding(tree, limits, live, slam, killed):
    limits.plan({slam: 20})
    (live() if killed else limits).plan({slam: 15})
    assert tree.limit(slam) == 15


def test_confirmed_earlier_limit_is_not_mistaken_for_rounding(tree, limits, slam):
    limits.plan({slam: 20})
    write(tree, limits, slam, 20)
    limits.plan({slam: 15})
    assert tree.limit(slam) == 15


def test_limit_rounded_by_systemd_is_not_rewritten(tree, limits, slam):
    limits.plan({slam: 15})
    write(tree, limits, slam, 20)
    limits.plan({slam: 15})
    assert tree.limit(slam) == 20
