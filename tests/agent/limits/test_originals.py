"""What the kubelet wrote before any policy, where that is not what the API says."""

from __future__ import annotations

import pytest

from tests.agent.builders import POLICY, SLAM
from tests.agent.limits.planned import resize, write

API = 2000
"""Of a Guaranteed container with two processors of its own (static CPU manager), which has no quota."""


@pytest.fixture
def free(tree):
    return tree.container(SLAM, limit=None, qos="Guaranteed")


def seen(tree, group):
    return tree.limit(group), tree.limit(group.parent)


def test_a_limit_that_the_kubelet_does_not_enforce_is_not_written(tree, limits, free):
    limits.plan({free: API}, original=API)
    assert seen(tree, free) == (None, None)
    limits.release(POLICY)
    assert seen(tree, free) == (None, None)


@pytest.mark.parametrize("leave_agreed", [False, True])
def test_a_container_without_a_quota_is_capped_and_freed_again(tree, limits, free, journal, leave_agreed):
    limits.plan({free: 10}, original=API)
    assert seen(tree, free) == (10, None)
    limits.plan({free: API}, original=API)
    assert seen(tree, free) == (None, None)
    limits.plan({free: 10}, original=API)
    limits.release(POLICY, leave_agreed=leave_agreed)
    assert seen(tree, free) == (None, None)
    assert journal.read_text() == ""


def test_the_next_run_restores_that_there_was_no_quota(tree, limits, live, free):
    limits.plan({free: 10}, original=API)
    heir = live()
    heir.plan({free: API}, original=API)
    assert seen(tree, free) == (None, None)
    heir.plan({free: 10}, original=API)
    live().release(POLICY)
    assert seen(tree, free) == (None, None)


def test_a_limit_that_the_owner_has_added_meanwhile_is_the_original(tree, limits, free):
    """It had none in the API either."""
    limits.plan({free: 10}, [free], original=None)
    write(tree, limits, free, 500)
    limits.plan({free: 500}, original=500)
    assert tree.limit(free) == 500
    limits.release(POLICY)
    assert tree.limit(free) == 500


def test_a_share_is_a_quota_also_where_the_kubelet_writes_none(tree, limits, free):
    limits.plan({free: 1500}, original=API)
    assert tree.limit(free) == 1500


def test_a_limit_that_the_api_has_raised_for_a_plan_is_not_the_original(tree, live, slam):
    """An agent that comes to a plan in force finds the plan's limit, which is larger."""
    resize(tree, live(), slam, 800)
    limits = live()
    limits.plan({slam: 800})
    limits.release(POLICY)
    assert tree.limit(slam) == 500
