"""Without room for the journal nothing is written that nobody could undo, and all goes on once there is room."""

from __future__ import annotations

import errno
import os
from time import monotonic

import pytest

from tests.agent.builders import (
    POLICY,
    SLAM,
    SPEECH,
    a_message,
    a_target,
)
from tests.agent.failing_writes.node import OTHER, failed, plan, realtime


@pytest.mark.parametrize("room", [0, 30])
def test_next_plan_is_applied_and_undoable_once_the_disk_has_room(node, room):
    plan(node.agent)
    node.disk.full, node.disk.room = True, room
    assert failed(plan(node.agent, 0.8, 0.2, sequence=2)) == {"a": "Unsaved", "b": "Unsaved"}
    assert node.limits() == (900, 100)
    node.disk.full = False
    assert failed(plan(node.agent, 0.7, 0.3, sequence=3)) == {}
    assert node.limits() == (700, 300)
    node.start().stop()
    assert node.limits() == (500, 500)


@pytest.mark.parametrize("undo", [lambda node: node.agent.hear(POLICY, None), lambda node: node.start().stop()])
@pytest.mark.parametrize("room", [0, 30])
def test_limits_written_before_the_disk_was_full_are_undone(node, undo, room):
    plan(node.agent)
    node.disk.full, node.disk.room = True, room
    plan(node.agent, 0.8, 0.2, sequence=2)
    undo(node)
    assert node.limits() == (500, 500)


def test_a_plan_that_needs_no_write_needs_no_room(node):
    plan(node.agent)
    node.disk.full = True
    assert failed(plan(node.agent, sequence=2)) == {}


def test_full_disk_does_not_block_other_policies(node):
    node.disk.full = True
    node.agent.hear(POLICY, a_message(a_target(SLAM, 0.9)))
    other = a_message(a_target(SPEECH, 0.2, task="speech"), policy=OTHER)
    assert failed(node.agent.hear(OTHER, other)) == {"b": "Unsaved"}
    node.disk.full = False
    assert failed(node.agent.hear(OTHER, other)) == {}
    assert node.limits() == (500, 200)


def test_externally_reverted_limit_is_not_restored_on_a_full_disk(node):
    plan(node.agent)
    node.disk.full = True
    node.tree.set(node.slam, 500)
    node.agent.on_other_write(node.slam_limit, monotonic())
    node.agent.hear(POLICY, None)
    assert node.tree.limit(node.slam) == 500


@pytest.mark.usefixtures("_threads")
@pytest.mark.parametrize("room", [0, 30])
def test_full_disk_keeps_budgets_and_they_can_be_undone(node, room):
    realtime(node.agent)
    node.disk.full, node.disk.room = True, room
    assert failed(realtime(node.agent, 0.4, 0.4, sequence=2)) == {"a": "Unsaved", "b": "Unsaved"}
    assert node.budgets() == (500, 300)
    node.agent.hear(POLICY, None)
    assert node.budgets() == (0, 0)
    assert node.tree.budget(node.tree.layout.top) == 0


@pytest.mark.usefixtures("_threads")
def test_budget_undo_on_a_full_disk_is_counted_as_unsaved(node):
    for policy, target in ((POLICY, a_target(SLAM, 1.0)), (OTHER, a_target(SPEECH, 0.6, task="speech"))):
        node.agent.hear(policy, a_message(target, policy=policy, scheduler="Realtime", capacity=1.9))
    node.disk.full = True
    node.agent.hear(POLICY, None)
    assert node.budgets() == (0, 300)
    assert node.agent.report()["refused"].keys() == {"Unsaved"}


def test_an_agent_without_a_journal_directory_works_once_it_exists(node, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patched:
        patched.setattr(os, "mkdir", full)
        assert failed(plan(node.start())) == {"a": "Unsaved", "b": "Unsaved"}
    assert failed(plan(node.agent)) == {}
    assert node.tree.limit(node.slam) == 900
