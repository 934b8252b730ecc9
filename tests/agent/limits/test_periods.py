"""The kubelet gives containers another period of quotas: cpuCFSQuotaPeriod, read when it starts."""

from __future__ import annotations

from time import monotonic

import pytest

from contextpolicy.agent.cgroup_paths import is_pod
from contextpolicy.agent.control_files import CFS
from tests.agent.builders import POLICY
from tests.agent.limits.planned import write

SHORT = 20_000
"""Microseconds; the kubelet's default is 100,000."""


def set_period(tree, group, period=SHORT):
    """Without a word of it to the agent."""
    path = period_file(tree, group)
    quota = tree.limit_file(group).read_text().split()[0]
    path.write_text(f"{period}\n" if tree.version == 1 else f"{quota} {period}\n")


def period_file(tree, group):
    return group / (CFS[tree.version].period_file or CFS[tree.version].file)


def quota(tree, group):
    return tree.limit_file(group).read_text().split()[0]


def resize(tree, group, limit, period=SHORT):
    """As the runtime does it: the period first, unless the quota of before would exceed the pod's limit then."""
    if is_pod(group):
        set_period(tree, group, period)
        yield period_file(tree, group)
    tree.limit_file(group).write_text(f"{limit * period // 1000}" + ("\n" if tree.version == 1 else f" {period}\n"))
    yield tree.limit_file(group)
    set_period(tree, group, period)
    yield period_file(tree, group)


@pytest.fixture(params=["reported", "not reported"])
def slam_of_short_period(request, tree, limits, slam):
    limits.plan({slam: 300})
    for group in (slam.parent, slam):
        for path in resize(tree, group, 500):
            if request.param == "reported":
                limits.on_other_write(path, monotonic())
    return slam


def test_a_plan_after_a_change_of_the_period_is_written_in_that_period(tree, limits, slam_of_short_period):
    limits.plan({slam_of_short_period: 400})
    assert quota(tree, slam_of_short_period) == "8000"


def test_an_original_of_another_period_is_put_back_in_the_new_one(tree, limits, slam_of_short_period):
    limits.plan({slam_of_short_period: 400})
    limits.release(POLICY)
    assert [quota(tree, group) for group in (slam_of_short_period, slam_of_short_period.parent)] == ["10000", "10000"]


def test_a_held_limit_is_restored_in_the_new_period(tree, limits, slam):
    limits.plan({slam: 300}, [slam])
    for path in resize(tree, slam, 500):
        limits.on_other_write(path, monotonic())
    assert quota(tree, slam) == "6000"


def test_a_resize_that_agrees_in_another_period_is_a_confirmation(tree, limits, slam, journal):
    limits.plan({slam: 300}, original=300)
    for path in resize(tree, slam, 300):
        limits.on_other_write(path, monotonic())
    limits.release(POLICY)
    assert (quota(tree, slam), journal.read_text()) == ("6000", "")


def test_a_period_that_is_written_as_it_was_confirms_nothing(tree, limits, slam):
    limits.plan({slam: 800})
    limits.plan({slam: 100})
    if tree.version == 1:
        limits.on_other_write(period_file(tree, slam), monotonic())
    write(tree, limits, slam, 800)
    assert tree.limit(slam) == 100
