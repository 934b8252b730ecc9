"""A limit that can't be written is not confirmed, and keeps nothing else from being written."""

from __future__ import annotations

import errno
import shutil

import pytest

from contextpolicy.agent.open_files import Unwatched
from tests.agent.builders import (
    CHAT,
    POLICY,
    SLAM,
    SPEECH,
    a_message,
    a_target,
)
from tests.agent.failing_writes.node import REASONS, failed, plan


@pytest.mark.parametrize("error", REASONS)
def test_a_limit_that_cannot_be_written_is_named_and_the_others_are_written(node, error):
    node.kernel.refuse("pwrite", node.slam_limit, error)
    confirmation = plan(node.agent)
    assert (confirmation.stamp, failed(confirmation)) == ((1, 1, 0), {"a": REASONS[error]})
    assert node.limits() == (500, 100)


@pytest.mark.parametrize("error", [errno.EACCES, errno.EMFILE, errno.ENOENT])
def test_a_file_that_cannot_be_opened_is_named(node, error):
    node.kernel.refuse("open", node.slam_limit, error)
    assert failed(plan(node.agent)).keys() == {"a"}
    assert node.limits() == (500, 100)


def test_a_container_that_ends_after_it_was_found_is_named(node):
    plan(node.agent)
    node.kernel.refuse("pread", node.slam_limit, errno.ENODEV)
    assert failed(plan(node.agent, 0.8, 0.2, sequence=2)) == {"a": "Gone"}
    assert node.tree.limit(node.speech) == 200
    assert node.agent.report()["refused"] == {}


def test_missing_container_is_named_but_a_starting_one_is_not(node):
    shutil.rmtree(node.slam)
    starting = a_target(CHAT, 0.1, task="chat", containerId="")
    message = a_message(a_target(SLAM, 0.4), a_target(SPEECH, 0.2, task="speech"), starting)
    assert failed(node.agent.hear(POLICY, message)) == {"a": "NotHere"}
    assert node.speech.exists()


def test_a_pod_that_cannot_grow_is_a_failure_of_its_containers(node):
    node.kernel.refuse("pwrite", node.tree.limit_file(node.slam.parent), errno.EINVAL)
    assert failed(plan(node.agent)) == {"a": "OutOfBounds"}


def test_a_pod_that_cannot_be_read_is_a_failure_of_its_containers(node):
    node.kernel.refuse("open", node.tree.limit_file(node.slam.parent), errno.EACCES)
    assert failed(plan(node.agent)) == {"a": "Forbidden"}
    assert node.tree.limit(node.speech) == 100


def test_a_file_that_cannot_be_watched_is_not_written(node):
    class Full(Unwatched):
        def add(self, path):
            if path == node.slam_limit:
                raise OSError(errno.ENOSPC, "inotify watch limit reached")

    agent = node.start(Full())
    assert failed(agent.hear(POLICY, a_message(a_target(SLAM, 0.9, limit=0.5)))) == {"a": "Failed"}
    assert node.tree.limit(node.slam) == 500


def test_incapable_node_confirms_no_container(node, monkeypatch):
    monkeypatch.setattr(node.agent._node, "missing", {"CFS": ["no CPU controller"]})
    assert failed(plan(node.agent)) == {"a": "Incapable", "b": "Incapable"}


def test_failures_are_counted_for_report_and_metrics(node):
    node.kernel.refuse("pwrite", node.slam_limit, errno.EROFS)
    plan(node.agent)
    assert node.agent.report()["refused"] == {"Forbidden": 1}
