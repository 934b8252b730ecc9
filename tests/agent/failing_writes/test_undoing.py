"""What a failed write leaves to be undone."""

from __future__ import annotations

import errno
from time import monotonic

from tests.agent.builders import (
    POLICY,
    Watch,
)
from tests.agent.failing_writes.node import failed, plan


def test_external_limit_survives_a_repeat_of_an_applied_plan(node):
    node.kernel.refuse("pwrite", node.slam_limit, errno.EBUSY)
    plan(node.agent)
    node.kernel.allow()
    plan(node.agent)
    node.tree.set(node.slam, 300)
    node.agent.on_other_write(node.slam_limit, monotonic())
    assert failed(plan(node.agent, edition=1)) == {}
    assert node.tree.limit(node.slam) == 300


def test_earlier_writes_are_undone_after_a_failed_write(node):
    plan(node.agent)
    node.kernel.refuse("pwrite", node.slam_limit, errno.EINVAL)
    plan(node.agent, 0.8, 0.2, sequence=2)
    assert node.limits() == (900, 200)
    node.kernel.allow()
    node.agent.hear(POLICY, None)
    assert node.limits() == (500, 500)


def test_a_failed_write_of_a_killed_agent_is_undone_to_the_original(node):
    plan(node.agent)
    node.kernel.refuse("pwrite", node.slam_limit, errno.EINVAL)
    plan(node.agent, 0.8, 0.2, sequence=2)
    node.kernel.allow()
    node.start().stop()
    assert node.tree.limit(node.slam) == 500


def test_resize_that_replaces_a_failed_write_stays_after_stop(node):
    node.agent.find_source(POLICY)
    plan(node.agent)
    node.kernel.refuse("pwrite", node.slam_limit, errno.EINVAL)
    plan(node.agent, 0.8, 0.2, sequence=2)
    node.kernel.allow()
    node.tree.set(node.slam, 800)
    node.agent.on_other_write(node.slam_limit, monotonic())
    node.agent.stop()
    assert node.tree.limit(node.slam) == 800


def test_files_with_a_pending_undo_stay_watched(node):
    watch = Watch()
    plan(node.start(watch))
    node.kernel.refuse("pwrite", node.slam_limit, errno.EBUSY)
    node.agent.hear(POLICY, None)
    groups = {path.parent for path in watch.paths}
    assert (groups, node.slam_limit in watch.paths) == ({node.slam, node.slam.parent}, True)


def test_a_limit_that_cannot_be_restored_is_counted(node):
    plan(node.agent)
    node.kernel.refuse("pwrite", node.slam_limit, errno.EROFS)
    node.tree.set(node.slam, 500)
    node.agent.on_other_write(node.slam_limit, monotonic())
    assert node.agent.report()["refused"] == {"Forbidden": 1}
