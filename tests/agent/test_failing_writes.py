"""What can't be written is not confirmed, keeps nothing else from being written, and is tried again."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path
from time import monotonic

import pytest
from reactivex.testing import TestScheduler

from contextpolicy.agent import capabilities, threads
from contextpolicy.agent.cgroup_paths import Driver
from contextpolicy.agent.control_files import REALTIME
from contextpolicy.agent.inotify import WriteWatch
from contextpolicy.errors import ActuationError
from tests.agent.builders import CHAT, POLICY, SLAM, SPEECH, Tree, a_message, a_target, an_agent

LAYOUTS = [(1, Driver.CGROUPFS), (1, Driver.SYSTEMD), (2, Driver.CGROUPFS), (2, Driver.SYSTEMD)]
OTHER = "robot/other"
WATCH = WriteWatch(lambda *_: None)
"""Watches in vain: tests say themselves who wrote what."""
REASONS = {
    errno.EROFS: "Forbidden",
    errno.EACCES: "Forbidden",
    errno.EINVAL: "OutOfBounds",
    errno.EBUSY: "Busy",
    errno.ENODEV: "Gone",
    errno.EIO: "Failed",
}


class Kernel:
    """System calls on files, of which some fail."""

    def __init__(self, monkeypatch):
        self._refused: dict[tuple[str, Path], int] = {}
        for name in ("pread", "pwrite", "write"):
            monkeypatch.setattr(os, name, self._checked(name, getattr(os, name), self._of_descriptor))
        monkeypatch.setattr(os, "open", self._checked("open", os.open, Path))

    def refuse(self, call, path, error):
        self._refused[call, path] = error

    def allow(self):
        self._refused.clear()

    def _checked(self, name, call, path_of):
        def checked(target, *arguments, **more):
            error = self._refused.get((name, path_of(target))) if self._refused else None
            if error is not None:
                raise OSError(error, os.strerror(error))
            return call(target, *arguments, **more)

        return checked

    def _of_descriptor(self, descriptor):
        return Path(f"/proc/self/fd/{descriptor}").readlink()


class Disk:
    """Where the journal is. When it is full, the last line may be cut short."""

    def __init__(self, monkeypatch):
        self.full, self.room = False, 0
        for owner, name in ((os, "write"), (Path, "write_bytes")):
            monkeypatch.setattr(owner, name, self._limited(getattr(owner, name)))

    def _limited(self, write):
        def limited(target, content):
            if not self.full or not content:
                return write(target, content)
            if not self.room:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            written, self.room = write(target, content[: self.room]), 0
            return written

        return limited


class Node:
    """A node with two containers of half a core each, and the agent on it."""

    def __init__(self, tree, state, monkeypatch):
        self.tree, self._state = tree, state
        self.slam, self.speech = tree.container(SLAM), tree.container(SPEECH)
        self.slam_limit, self.slam_budget = tree.limit_file(self.slam), self.slam / REALTIME[tree.version].file
        self.kernel, self.disk = Kernel(monkeypatch), Disk(monkeypatch)
        self.agent = self.start()

    def start(self, watch=WATCH):
        """An agent, or another one after it."""
        self.agent = an_agent(self.tree, self._state, TestScheduler(), watch)
        self.agent.start()
        return self.agent

    def limits(self):
        return self.tree.limit(self.slam), self.tree.limit(self.speech)

    def budgets(self):
        return self.tree.budget(self.slam), self.tree.budget(self.speech)


@pytest.fixture(params=LAYOUTS, ids=str)
def node(request, tmp_path, monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    monkeypatch.setattr(capabilities, "_has_capability", lambda _: True)
    return Node(Tree(tmp_path / "cgroup", *request.param), tmp_path / "state", monkeypatch)


def plan(agent, slam=0.9, speech=0.1, policy=POLICY, **more):
    return agent.hear(policy, a_message(a_target(SLAM, slam), a_target(SPEECH, speech, task="speech"), **more))


def failed(confirmation):
    """The reasons by the container's first letter."""
    return {identity.removeprefix("containerd://")[0]: reason for identity, reason in confirmation.failed.items()}


# writes of limits


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


def test_a_container_that_is_not_here_is_named_but_not_one_that_starts(node):
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
    class Full(WriteWatch):
        def add(self, path):
            if path == node.slam_limit:
                raise OSError(errno.ENOSPC, "inotify watch limit reached")

    agent = node.start(Full(lambda *_: None))
    assert failed(agent.hear(POLICY, a_message(a_target(SLAM, 0.9, limit=0.5)))) == {"a": "Failed"}
    assert node.tree.limit(node.slam) == 500


def test_a_node_that_cannot_do_what_a_plan_wants_confirms_no_container(node, monkeypatch):
    monkeypatch.setattr(node.agent, "_missing", {"CFS": ["no CPU controller"]})
    assert failed(plan(node.agent)) == {"a": "Incapable", "b": "Incapable"}


def test_failures_are_counted_for_report_and_metrics(node):
    node.kernel.refuse("pwrite", node.slam_limit, errno.EROFS)
    plan(node.agent)
    assert node.agent.report()["refused"] == {"Forbidden": 1}


# once more


@pytest.mark.parametrize("edition", [0, 1])
def test_a_plan_that_failed_is_tried_again_when_it_is_repeated(node, edition):
    node.kernel.refuse("pwrite", node.slam_limit, errno.EBUSY)
    for _ in range(2):
        assert failed(plan(node.agent)) == {"a": "Busy"}
    node.kernel.allow()
    assert failed(plan(node.agent, edition=edition)) == {}
    assert node.tree.limit(node.slam) == 900


def test_once_it_is_carried_out_what_an_owner_writes_stays_when_it_is_repeated(node):
    node.kernel.refuse("pwrite", node.slam_limit, errno.EBUSY)
    plan(node.agent)
    node.kernel.allow()
    plan(node.agent)
    node.tree.set(node.slam, 300)
    node.agent.on_other_write(node.slam_limit, monotonic())
    assert failed(plan(node.agent, edition=1)) == {}
    assert node.tree.limit(node.slam) == 300


def test_a_write_that_failed_leaves_what_was_written_before_to_be_undone(node):
    plan(node.agent)
    node.kernel.refuse("pwrite", node.slam_limit, errno.EINVAL)
    plan(node.agent, 0.8, 0.2, sequence=2)
    assert node.limits() == (900, 200)
    node.kernel.allow()
    node.agent.hear(POLICY, None)
    assert node.limits() == (500, 500)


def test_a_killed_agents_failed_write_leaves_what_was_written_before_to_be_undone(node):
    plan(node.agent)
    node.kernel.refuse("pwrite", node.slam_limit, errno.EINVAL)
    plan(node.agent, 0.8, 0.2, sequence=2)
    node.kernel.allow()
    node.start().stop()
    assert node.tree.limit(node.slam) == 500


def test_a_resize_that_does_what_the_agent_could_not_is_left_at_the_agents_end(node):
    node.agent.find_source(POLICY)
    plan(node.agent)
    node.kernel.refuse("pwrite", node.slam_limit, errno.EINVAL)
    plan(node.agent, 0.8, 0.2, sequence=2)
    node.kernel.allow()
    node.tree.set(node.slam, 800)
    node.agent.on_other_write(node.slam_limit, monotonic())
    node.agent.stop()
    assert node.tree.limit(node.slam) == 800


def test_what_cannot_be_undone_now_is_undone_later(node):
    plan(node.agent)
    node.kernel.refuse("pwrite", node.slam_limit, errno.EBUSY)
    node.agent.hear(POLICY, None)
    assert node.limits() == (900, 500)
    node.kernel.allow()
    node.agent.stop()
    assert node.tree.limit(node.slam) == 500


def test_what_is_still_to_be_undone_is_still_watched(node):
    watched = set()

    class Noting(WriteWatch):
        def add(self, path):
            watched.add(path)

        def remove(self, path):
            watched.remove(path)

    plan(node.start(Noting(lambda *_: None)))
    node.kernel.refuse("pwrite", node.slam_limit, errno.EBUSY)
    node.agent.hear(POLICY, None)
    assert watched == {node.slam_limit, node.slam_limit.parent.parent / node.slam_limit.name}


def test_a_limit_that_cannot_be_restored_is_counted(node):
    plan(node.agent)
    node.kernel.refuse("pwrite", node.slam_limit, errno.EROFS)
    node.tree.set(node.slam, 500)
    node.agent.on_other_write(node.slam_limit, monotonic())
    assert node.agent.report()["refused"] == {"Forbidden": 1}


# realtime


@pytest.fixture
def _threads(monkeypatch):
    """No test may change real threads."""
    monkeypatch.setattr(threads, "make_realtime", lambda *_: None)
    monkeypatch.setattr(threads, "make_ordinary", lambda *_: None)


def realtime(agent, slam=0.5, speech=0.3, **more):
    """Parts of each of the two processors' periods."""
    return plan(agent, 2 * slam, 2 * speech, scheduler="Realtime", capacity=1.9, **more)


@pytest.mark.usefixtures("_threads")
@pytest.mark.parametrize("error", REASONS)
def test_a_budget_that_cannot_be_written_is_named_and_the_others_are_written(node, error):
    node.kernel.refuse("pwrite", node.slam_budget, error)
    assert failed(realtime(node.agent)) == {"a": REASONS[error]}
    assert node.budgets() == (0, 300)


@pytest.mark.usefixtures("_threads")
def test_a_budget_that_cannot_be_opened_is_named(node):
    node.kernel.refuse("open", node.slam_budget, errno.EMFILE)
    assert failed(realtime(node.agent)) == {"a": "Failed"}
    assert node.tree.budget(node.speech) == 300
    node.kernel.allow()
    assert failed(realtime(node.agent)) == {}
    assert node.tree.budget(node.slam) == 500


@pytest.mark.usefixtures("_threads")
def test_a_budget_that_cannot_be_read_for_once_is_still_undone(node):
    realtime(node.agent)
    node.kernel.refuse("pread", node.slam_budget, errno.EIO)
    assert failed(realtime(node.agent, 0.4, 0.4, sequence=2)) == {"a": "Failed"}
    node.kernel.allow()
    node.agent.hear(POLICY, None)
    assert node.budgets() == (0, 0)


@pytest.mark.usefixtures("_threads")
@pytest.mark.parametrize("node", LAYOUTS[:2], indirect=True, ids=str)
def test_a_period_that_cannot_be_put_back_now_is_counted_and_put_back_later(node):
    period = node.slam / "cpu.rt_period_us"
    realtime(node.agent)
    text = period.read_text()
    period.unlink()
    period.mkdir()
    node.agent.hear(POLICY, None)
    assert node.agent.report()["refused"].keys() == {"Failed"}
    period.rmdir()
    period.write_text(text)
    node.agent.stop()
    assert (int(text), int(period.read_text())) == (100_000, 1_000_000)


@pytest.mark.usefixtures("_threads")
def test_a_suspended_tasks_limit_that_cannot_be_written_is_named(node):
    node.kernel.refuse("pwrite", node.tree.limit_file(node.speech), errno.EROFS)
    assert failed(realtime(node.agent, 0.949, 0.001, suspended=("speech",))) == {"b": "Forbidden"}


def test_threads_that_cannot_enter_realtime_are_named(node, monkeypatch):
    def refuse(group, *_):
        if group == node.slam:
            raise ActuationError("Forbidden", "no capability", retriable=False)

    monkeypatch.setattr(threads, "make_realtime", refuse)
    assert failed(realtime(node.agent)) == {"a": "Forbidden"}


# the journal


def test_without_room_for_the_journal_nothing_is_written_and_all_is_said(node):
    node.disk.full = True
    for _ in range(2):
        assert failed(plan(node.agent)) == {"a": "Unsaved", "b": "Unsaved"}
    assert node.limits() == (500, 500)
    assert node.agent.report()["refused"].keys() == {"Unsaved"}


@pytest.mark.parametrize("room", [0, 30])
def test_once_there_is_room_the_next_plan_is_carried_out_and_can_be_undone(node, room):
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
def test_what_was_written_while_there_was_room_is_undone(node, undo, room):
    plan(node.agent)
    node.disk.full, node.disk.room = True, room
    plan(node.agent, 0.8, 0.2, sequence=2)
    undo(node)
    assert node.limits() == (500, 500)


def test_a_plan_that_needs_no_write_needs_no_room(node):
    plan(node.agent)
    node.disk.full = True
    assert failed(plan(node.agent, sequence=2)) == {}


def test_without_room_other_policies_plans_are_heard(node):
    node.disk.full = True
    node.agent.hear(POLICY, a_message(a_target(SLAM, 0.9)))
    other = a_message(a_target(SPEECH, 0.2, task="speech"), policy=OTHER)
    assert failed(node.agent.hear(OTHER, other)) == {"b": "Unsaved"}
    node.disk.full = False
    assert failed(node.agent.hear(OTHER, other)) == {}
    assert node.limits() == (500, 200)


def test_without_room_a_limit_that_somebody_took_back_is_not_restored(node):
    plan(node.agent)
    node.disk.full = True
    node.tree.set(node.slam, 500)
    node.agent.on_other_write(node.slam_limit, monotonic())
    node.agent.hear(POLICY, None)
    assert node.tree.limit(node.slam) == 500


@pytest.mark.usefixtures("_threads")
@pytest.mark.parametrize("room", [0, 30])
def test_without_room_budgets_stay_as_they_are_and_can_be_undone(node, room):
    realtime(node.agent)
    node.disk.full, node.disk.room = True, room
    assert failed(realtime(node.agent, 0.4, 0.4, sequence=2)) == {"a": "Unsaved", "b": "Unsaved"}
    assert node.budgets() == (500, 300)
    node.agent.hear(POLICY, None)
    assert node.budgets() == (0, 0)
    assert node.tree.budget(node.tree.layout.top) == 0


@pytest.mark.usefixtures("_threads")
def test_budgets_that_are_undone_without_room_are_counted(node):
    for policy, target in ((POLICY, a_target(SLAM, 1.0)), (OTHER, a_target(SPEECH, 0.6, task="speech"))):
        node.agent.hear(policy, a_message(target, policy=policy, scheduler="Realtime", capacity=1.9))
    node.disk.full = True
    node.agent.hear(POLICY, None)
    assert node.budgets() == (0, 300)
    assert node.agent.report()["refused"].keys() == {"Unsaved"}


def test_an_agent_that_starts_without_a_place_for_its_journal_works_once_there_is_one(node, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patched:
        patched.setattr(os, "mkdir", full)
        assert failed(plan(node.start())) == {"a": "Unsaved", "b": "Unsaved"}
    assert failed(plan(node.agent)) == {}
    assert node.tree.limit(node.slam) == 900
