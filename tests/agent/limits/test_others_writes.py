"""What the kubelet, an owner or systemd writes: a confirmation, a decision, or an earlier plan's resize."""

from __future__ import annotations

import pytest

from tests.agent.builders import POLICY
from tests.agent.limits.planned import resize, write


def test_a_resize_of_an_earlier_plan_is_overwritten_and_remembered(tree, limits, slam):
    limits.plan({slam: 800})
    limits.plan({slam: 100})
    write(tree, limits, slam, 800)
    assert tree.limit(slam) == 100
    limits.release(POLICY, leave_agreed=True)
    assert tree.limit(slam) == 800


def test_external_writes_stay_after_the_newest_plan_is_confirmed(tree, limits, slam):
    limits.plan({slam: 800})
    limits.plan({slam: 100})
    write(tree, limits, slam, 100)
    write(tree, limits, slam, 800)
    assert tree.limit(slam) == 800


def test_another_owners_value_stays_until_the_next_plan(tree, limits, slam):
    limits.plan({slam: 800})
    write(tree, limits, slam, 300)
    assert tree.limit(slam) == 300
    limits.plan({slam: 900})
    assert tree.limit(slam) == 900
    limits.release(POLICY, leave_agreed=True)
    assert tree.limit(slam) == 300


def test_external_limit_is_not_undone(tree, limits, slam):
    limits.plan({slam: 10})
    resize(tree, limits, slam, 10)
    resize(tree, limits, slam, 300)
    limits.release(POLICY)
    assert tree.limit(slam) == 300


def test_limit_reapplied_after_an_external_write_can_be_undone(tree, limits, slam):
    limits.plan({slam: 10})
    for limit in (10, 300, 10):
        resize(tree, limits, slam, limit)
    limits.release(POLICY)
    assert tree.limit(slam) == 500


def test_systemd_rewriting_the_old_limit_is_not_an_external_change(tree, limits, slam):
    """At `daemon-reload` and `set-property` systemd writes the value it was last given, from before our write."""
    limits.plan({slam: 800})
    for _ in range(2):
        write(tree, limits, slam, 500)
        assert (tree.limit(slam), tree.limit(slam.parent)) == (800, 800)


def test_limits_rewritten_by_systemd_can_still_be_undone(tree, limits, slam):
    limits.plan({slam: 800})
    write(tree, limits, slam.parent, 500)
    write(tree, limits, slam, 500)
    limits.release(POLICY)
    assert (tree.limit(slam), tree.limit(slam.parent)) == (500, 500)


@pytest.mark.parametrize("already", [False, True])
def test_held_limit_survives_resizes_and_is_restored(tree, limits, slam, already):
    if already:
        tree.set(slam, 10)
    limits.plan({slam: 10}, [slam])
    resize(tree, limits, slam, 100)
    assert tree.limit(slam) == 10
    limits.release(POLICY)
    assert (tree.limit(slam), tree.limit(slam.parent)) == (500, 500)


def test_held_and_unheld_limits_coexist(tree, limits, slam, speech):
    """The kubelet writes what the API has: the request of the one, the very limit of the other."""
    limits.plan({slam: 10, speech: 400}, [slam])
    write(tree, limits, slam, 300)
    write(tree, limits, speech, 400)
    write(tree, limits, speech, 450)
    assert (tree.limit(slam), tree.limit(speech)) == (10, 450)
