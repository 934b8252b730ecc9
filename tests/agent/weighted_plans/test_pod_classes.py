"""Pods beside which a class is weighed: they end, come again, and belong to several policies."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path
from time import monotonic

import pytest

from tests.agent.builders import POLICY, SLAM, SPEECH, a_message, a_target
from tests.agent.weighted_plans.node import refuse


@pytest.fixture
def _ended(monkeypatch):
    """The kernel reads no file of a group that has ended, however long it was open."""
    read = os.pread

    def pread(file, *rest):
        if str(Path(f"/proc/self/fd/{file}").readlink()).endswith(" (deleted)"):
            raise OSError(errno.ENODEV, "no such device")
        return read(file, *rest)

    monkeypatch.setattr(os, "pread", pread)


@pytest.mark.usefixtures("_ended")
def test_a_pod_that_has_ended_no_longer_counts_in_its_class(node):
    node.plan((1.0, 0.5), (0.3, 0.5))
    shutil.rmtree(node.slam.parent)
    group = node.speech.parent.parent
    node.tree.set_weight(group, 2)
    node.agent.on_other_write(node.tree.weight_file(group), monotonic())
    assert node.tree.weight(group) == node.tree.weight(node.speech.parent)


@pytest.mark.usefixtures("_ended")
def test_a_pod_that_takes_the_place_of_another_counts(node):
    before = node.tree.container("4" * 64, uid="uid-x")
    node.plan((1.0, 0.5), (0.3, 0.5))
    shutil.rmtree(before.parent)
    after = node.tree.container("5" * 64, uid="uid-y")
    node.tree.set_weight(after.parent, 900)
    group = after.parent.parent
    node.tree.set_weight(group, 5)
    node.agent.on_other_write(node.tree.weight_file(group), monotonic())
    pods = node.slam.parent, node.speech.parent, after.parent
    assert node.tree.weight(group) == sum(node.tree.weight(pod) for pod in pods)


@pytest.mark.usefixtures("_ended")
@pytest.mark.parametrize("others", [[SPEECH], []], ids=["among others", "the only one"])
def test_a_pod_of_ours_that_takes_the_place_of_another_of_ours_counts(node, others):
    if not others:
        shutil.rmtree(node.speech.parent)
    beside = [a_target(identity, 0.3, task="speech", weight=0.3) for identity in others]
    node.agent.hear(POLICY, a_message(a_target(SLAM, 0.5, weight=1.0), *beside))
    shutil.rmtree(node.slam.parent)
    after = node.tree.container("d" * 64)
    group = after.parent.parent
    node.tree.set_weight(group, 2)
    said = node.agent.hear(POLICY, a_message(a_target("d" * 64, 0.5, weight=1.0), *beside, sequence=2))
    pods = [after.parent, *(node.speech.parent for _ in others)]
    assert (said.failed, node.tree.weight(group)) == ({}, sum(node.tree.weight(pod) for pod in pods))


def test_a_pod_of_two_policies_gets_its_limit_back_with_the_last(node):
    """While the other policy's container is larger, the kernel would refuse the pod's former limit."""
    containers = {
        "robot/p": node.tree.container("1" * 64, uid="uid-x", limit=250),
        "robot/q": node.tree.container("2" * 64, uid="uid-x", limit=250),
    }
    for policy, group in containers.items():
        target = a_target("12"[policy == "robot/q"] * 64, 1.0, task="t", uid="uid-x", original=0.25)
        node.agent.hear(policy, a_message(target, policy=policy, capacity=2.0))
        assert node.tree.limit(group) == 1000
    node.agent.hear("robot/q", None)
    node.agent.hear("robot/p", None)
    pod = containers["robot/p"].parent
    assert [node.tree.limit(group) for group in (*containers.values(), pod)] == [250, 250, 500]


def test_a_pod_gets_its_limit_back_once_its_container_has(node, monkeypatch):
    group = node.tree.container("1" * 64, uid="uid-x", limit=250)
    target = a_target("1" * 64, 1.0, task="t", uid="uid-x", original=0.25)
    node.agent.hear("robot/p", a_message(target, policy="robot/p", capacity=2.0))
    write = os.pwrite

    def refuse_one(file, text, offset):
        if Path(f"/proc/self/fd/{file}").readlink() == node.tree.limit_file(group):
            refuse()
        return write(file, text, offset)

    with monkeypatch.context() as broken:
        broken.setattr(os, "pwrite", refuse_one)
        node.agent.hear("robot/p", None)
    node.agent.stop()
    assert (node.tree.limit(group), node.tree.limit(group.parent)) == (250, 250)
