"""The agent under `control: Weight` and `Suspend`: weights at once, quotas once the input at hand is done."""

from __future__ import annotations

import errno
import os
import shutil
from datetime import timedelta
from math import inf
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

import pytest
from reactivex.testing import TestScheduler

from contextpolicy.agent import capabilities
from contextpolicy.agent.cgroup_paths import Driver
from contextpolicy.agent.drains import DRAIN
from contextpolicy.agent.weight_units import of_container, of_pod
from tests.agent.builders import POLICY, SLAM, SPEECH, Tree, a_message, a_target, an_agent
from tests.agent.test_cpu_weights import Watch

if TYPE_CHECKING:
    from contextpolicy.cluster.agent_reports import Confirmation

LAYOUTS = [(1, Driver.CGROUPFS), (1, Driver.SYSTEMD), (2, Driver.CGROUPFS), (2, Driver.SYSTEMD)]


class Node:
    """Two tasks and their agent."""

    def __init__(self, folder, layout):
        self.tree = Tree(folder / "cgroup", *layout)
        self.slam, self.speech = self.tree.container(SLAM), self.tree.container(SPEECH)
        self.watch, self._sequence = Watch(), 0
        self._state = folder / "state"
        self.start()

    def start(self):
        """Start an agent; one before it was killed."""
        self.time = TestScheduler()
        self.agent = an_agent(self.tree, self._state, self.time, self.watch)
        self.agent.start()
        self.agent.find_source(POLICY)

    def plan(self, slam, speech, **more):
        """Each is (weight, quota); a weight of 0 is suspended."""
        self._sequence += 1
        targets = [
            a_target(identity, 0.5, task=task, weight=weight, quota=quota, **more)
            for identity, task, (weight, quota) in ((SLAM, "slam", slam), (SPEECH, "speech", speech))
        ]
        suspended = tuple(task for task, (weight, _) in (("slam", slam), ("speech", speech)) if weight == 0)
        return self.agent.hear(POLICY, a_message(*targets, sequence=self._sequence, suspended=suspended))

    def repeat(self, *plan, **more):
        """The operator says the same again."""
        self._sequence -= 1
        return self.plan(*plan, **more)

    @property
    def journal(self):
        return self._state / "agent.journal"

    def kubelet(self, group, limit):
        """The kubelet writes a limit and the watch tells."""
        self.tree.set(group, limit)
        self.agent.on_other_write(self.tree.limit_file(group), monotonic())

    def groups(self):
        """Slam's container, its pod, and the class of both pods."""
        return [self.slam, self.slam.parent, self.slam.parent.parent]

    def everything(self):
        return [self.tree.weight(group) for group in self.groups()], self.limits()

    def foreign(self, everything):
        """Somebody else writes all of that."""
        weights, limits = everything
        for group, weight in zip(self.groups(), weights, strict=True):
            self.tree.set_weight(group, weight)
        for group, limit in zip((self.slam, self.speech), limits, strict=True):
            self.tree.set(group, limit)

    def wait(self, seconds):
        self.time.advance_by(timedelta(seconds=seconds).total_seconds())

    def weights(self):
        return self.tree.weight(self.slam), self.tree.weight(self.speech)

    def limits(self):
        return self.tree.limit(self.slam), self.tree.limit(self.speech)

    def expected(self, *cores):
        return tuple(of_container(amount, self.tree.version) for amount in cores)


@pytest.fixture(autouse=True)
def _able(monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    monkeypatch.setattr(capabilities, "_has_capability", lambda _: True)


@pytest.fixture(params=LAYOUTS, ids=str)
def node(request, tmp_path):
    return Node(tmp_path, request.param)


ACTIVE, ASLEEP = (1.5, 0.5), (0, 0.01)


def test_weights_are_written_at_once_and_limits_stay(node):
    assert node.plan(ACTIVE, (0.3, 0.5)).failed == {}
    assert node.weights() == node.expected(1500, 300)
    assert node.limits() == (500, 500)
    assert node.tree.weight(node.slam.parent) == of_pod(1500, node.tree.version)


def test_a_suspended_task_weighs_least_at_once_and_is_capped_once_its_input_is_done(node):
    node.plan(ACTIVE, (0.3, 0.5))
    node.plan(ACTIVE, ASLEEP)
    assert (node.weights(), node.limits()) == (node.expected(1500, 0), (500, 500))
    node.wait(DRAIN - 0.01)
    assert node.limits() == (500, 500)
    node.wait(0.02)
    assert node.limits() == (500, 10)


def test_plans_that_come_meanwhile_put_nothing_off(node):
    node.plan(ACTIVE, (0.3, 0.5))
    for _ in range(4):
        node.plan(ACTIVE, ASLEEP)
        node.wait(DRAIN / 3)
    assert node.limits() == (500, 10)


def test_a_task_that_wakes_meanwhile_is_never_capped(node):
    node.plan(ACTIVE, ASLEEP)
    node.wait(DRAIN / 2)
    node.plan(ACTIVE, (0.3, 0.5))
    node.wait(2 * DRAIN)
    assert node.limits() == (500, 500)


def test_a_task_wakes_at_once(node):
    node.plan(ACTIVE, ASLEEP)
    node.wait(1)
    node.plan(ACTIVE, (0.3, 0.5))
    assert (node.weights(), node.limits()) == (node.expected(1500, 300), (500, 500))


def test_what_is_suspended_stays_so_when_another_task_is(node):
    node.plan(ACTIVE, ASLEEP)
    node.wait(1)
    node.plan(ASLEEP, ASLEEP)
    assert node.limits() == (500, 10)
    node.wait(1)
    assert node.limits() == (10, 10)


def test_without_weights_a_quota_comes_at_once(node):
    node.plan((None, 0.5), (None, 0.01))
    assert (node.limits(), node.weights()) == ((500, 10), (100, 100) if node.tree.version == 2 else (1024, 1024))


def test_the_kubelet_writes_what_the_api_has_and_ours_comes_back(node):
    node.plan(ACTIVE, ASLEEP, held=True)
    node.wait(1)
    node.tree.set(node.speech, 300)
    node.tree.set_weight(node.speech, 77)
    for path in (node.tree.limit_file(node.speech), node.tree.weight_file(node.speech)):
        node.agent.on_other_write(path, monotonic())
    assert (node.limits(), node.weights()) == ((500, 10), node.expected(1500, 0))


def test_everything_written_is_watched(node):
    node.plan(ACTIVE, ASLEEP)
    groups = [node.slam, node.slam.parent, node.slam.parent.parent]
    assert {node.tree.weight_file(group) for group in groups} <= node.watch.paths


@pytest.mark.parametrize("seconds", [0, 1])
def test_a_policy_that_is_deleted_leaves_no_trace_whenever_it_is(node, seconds):
    before = node.limits(), node.weights(), node.tree.weight(node.slam.parent.parent)
    node.plan(ACTIVE, ASLEEP)
    node.wait(seconds)
    node.agent.hear(POLICY, None)
    node.wait(1)
    assert (node.limits(), node.weights(), node.tree.weight(node.slam.parent.parent)) == before


@pytest.mark.parametrize("seconds", [0, 1])
def test_an_agent_that_was_killed_is_undone_by_the_next(node, seconds):
    before = node.limits(), node.weights(), node.tree.weight(node.slam.parent.parent)
    node.plan(ACTIVE, ASLEEP)
    node.wait(seconds)
    node.start()
    node.agent.lose_source(POLICY)
    node.wait(60)
    assert (node.limits(), node.weights(), node.tree.weight(node.slam.parent.parent)) == before


def test_every_suspended_task_has_its_time(node):
    node.plan(ACTIVE, (0.3, 0.5))
    node.plan(ACTIVE, ASLEEP)
    node.wait(DRAIN - 0.02)
    node.plan(ASLEEP, ASLEEP)
    node.wait(0.05)
    assert node.limits() == (500, 10)
    node.wait(DRAIN)
    assert node.limits() == (10, 10)


def test_a_task_that_was_awake_in_between_has_its_time_again(node):
    node.plan(ASLEEP, ACTIVE)
    node.wait(0.3)
    node.plan(ACTIVE, ASLEEP)
    node.wait(0.15)
    node.plan(ASLEEP, ACTIVE)
    node.wait(0.1)
    assert node.limits() == (500, 500)


@pytest.mark.parametrize("agreed", [False, True])
def test_a_suspended_task_stays_so_when_the_agent_starts_again(node, agreed):
    node.plan(ACTIVE, ASLEEP)
    node.wait(1)
    if agreed:
        node.kubelet(node.speech, 10)
    node.start()
    node.plan(ACTIVE, ASLEEP, limit=0.01 if agreed else 0.5)
    assert node.limits() == (500, 10)
    node.wait(1)
    assert node.limits() == (500, 10)


def test_reports_of_what_was_overwritten_undo_nothing(node):
    """A resize writes twice, systemd for itself and the runtime; both reports wait while ours is put back."""
    before = node.everything()
    node.plan(ACTIVE, ASLEEP, held=True)
    node.wait(1)
    files = [*map(node.tree.weight_file, node.groups()), node.tree.limit_file(node.speech)]
    node.foreign(before)
    heard = monotonic()
    for path in files + files:
        node.agent.on_other_write(path, heard)
    assert (node.limits(), node.weights()) == ((500, 10), node.expected(1500, 0))
    node.agent.stop()
    assert node.everything() == before


def test_lost_reports_undo_nothing(node):
    before = node.everything()
    node.plan(ACTIVE, ASLEEP)
    node.wait(1)
    for path in list(node.watch.paths):
        node.agent.on_other_write(path, -inf)
    node.agent.hear(POLICY, None)
    assert node.everything() == before


def test_a_quota_that_fails_later_is_reported(node, monkeypatch):
    late: list[Confirmation] = []
    node.agent.late.subscribe(late.append)
    node.plan(ACTIVE, ASLEEP)
    with monkeypatch.context() as broken:
        broken.setattr(os, "pwrite", refuse)
        node.wait(1)
    assert [(said.stamp, list(said.failed.values())) for said in late] == [((1, 1, 0), ["Forbidden"])]
    node.repeat(ACTIVE, ASLEEP)
    assert node.limits() == (500, 10)


def test_a_value_that_can_not_be_put_back_is_reported_and_tried_again(node, monkeypatch):
    late: list[Confirmation] = []
    node.agent.late.subscribe(late.append)
    node.plan(ACTIVE, ASLEEP, held=True)
    node.wait(1)
    with monkeypatch.context() as broken:
        broken.setattr(os, "pwrite", refuse)
        node.kubelet(node.speech, 500)
    assert [list(said.failed) for said in late] == [[f"containerd://{SPEECH}"]]
    node.repeat(ACTIVE, ASLEEP, held=True)
    assert node.limits() == (500, 10)


def test_what_others_write_while_no_agent_runs_comes_back_in_the_end(node):
    node.plan(ACTIVE, (0.3, 0.5))
    node.tree.set_weight(node.slam, 55)
    node.tree.set_weight(node.slam.parent, 56)
    node.start()
    node.plan(ACTIVE, (0.3, 0.5))
    node.agent.hear(POLICY, None)
    assert (node.tree.weight(node.slam), node.tree.weight(node.slam.parent)) == (55, 56)


def test_weights_that_follow_a_score_leave_the_journal_small(node):
    for step in range(400):
        node.plan((round(0.3 + step * 0.001, 3), 0.5), (0.3, 0.5))
    before = node.journal.stat().st_size
    node.plan((1.2, 0.5), (0.3, 0.5))
    assert node.journal.stat().st_size - before < 2000


def test_a_weight_beside_the_classes_is_never_written(node):
    before = node.tree.weight(node.tree.layout.top)
    node.plan((0.3, 0.5), (0.3, 0.5), qos="Guaranteed")
    assert node.tree.weight(node.tree.layout.top) == before


def test_a_limit_that_systemd_has_rounded_is_left_as_it_is(node):
    node.tree.set(node.slam, 340)
    node.plan((0.5, 0.333), (0.3, 0.5), original=0.333)
    assert node.limits() == (340, 500)


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
def test_a_pod_that_has_ended_counts_no_more_in_its_class(node):
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


def refuse(*_):
    raise OSError(errno.EROFS, "read-only")
