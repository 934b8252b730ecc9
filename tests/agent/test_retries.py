"""What failed is tried again after growing pauses, whether or not the operator says anything more."""

from __future__ import annotations

import errno
from time import monotonic

import pytest
from reactivex.testing import TestScheduler

from contextpolicy.agent import capabilities
from contextpolicy.agent.cgroup_paths import Driver
from contextpolicy.agent.drains import DRAIN
from contextpolicy.agent.ledger import Ledger
from contextpolicy.agent.retries import AGAIN, Retries
from tests.agent.builders import POLICY, SLAM, SPEECH, Tree, a_message, a_target
from tests.agent.failing_writes.node import OTHER, Node, failed, plan

LAYOUTS = [(1, Driver.CGROUPFS), (2, Driver.SYSTEMD)]
LONG = 2 * AGAIN.longest


class Tried:
    """Notes when something is tried, which fails so many times."""

    def __init__(self, failures):
        self.time, self.at, self._failures = TestScheduler(), [], failures
        self.retries = Retries(self.time, self)
        self.retries.again("one")

    def on_retry(self, key):
        self.at.append(self.time.clock)
        if len(self.at) < self._failures:
            self.retries.again(key)
        else:
            self.retries.end(key)


def test_pauses_grow_up_to_the_longest():
    tried = Tried(failures=8)
    tried.time.advance_by(1000)
    assert tried.at == [1, 3, 7, 15, 31, 61, 91, 121]


def test_further_failures_do_not_postpone_the_retry():
    tried = Tried(failures=1)
    for _ in range(4):
        tried.time.advance_by(0.4)
        tried.retries.again("one")
    assert tried.at == [1]


def test_after_a_success_pauses_begin_again():
    tried = Tried(failures=3)
    tried.time.advance_by(20)
    tried.retries.again("one")
    tried.time.advance_by(1)
    assert tried.at == [1, 3, 7, 21]


def test_finished_trials_are_not_repeated():
    tried = Tried(failures=1)
    tried.retries.end("one")
    tried.time.advance_by(1000)
    tried.retries.again("one")
    tried.retries.stop()
    tried.time.advance_by(1000)
    assert tried.at == []


class Retrying(Node):
    """An agent that knows of the policy's source, and what it reports late."""

    def start(self, *watch):
        agent = super().start(*watch)
        self.late: list[object] = []
        agent.late.subscribe(lambda said: self.late.append(failed(said)))
        agent.find_source(POLICY)
        return agent

    def refuse(self, group, error=errno.EBUSY):
        self.kernel.refuse("pwrite", self.tree.limit_file(group), error)

    def say(self, *tasks, **more):
        """Plan for slam, and speech if it is among the `tasks`."""
        known = {"slam": a_target(SLAM, 0.8), "speech": a_target(SPEECH, 0.01, task="speech")}
        return self.agent.hear(POLICY, a_message(*(known[task] for task in tasks), **more))


@pytest.fixture(params=LAYOUTS, ids=str)
def node(request, tmp_path, monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    monkeypatch.setattr(capabilities, "_has_capability", lambda _: True)
    return Retrying(Tree(tmp_path / "cgroup", *request.param), tmp_path / "state", monkeypatch)


# undoing


def test_dropped_container_is_reported_until_undone(node):
    node.say("slam", "speech")
    node.refuse(node.speech)
    assert failed(node.say("slam", sequence=2)) == {"b": "Busy"}
    node.time.advance_by(LONG)
    assert node.late[-1] == {"b": "Busy"}
    node.kernel.allow()
    node.time.advance_by(LONG)
    assert (node.tree.limit(node.speech), node.late[-1]) == (500, {})


def test_successful_undo_ends_the_retries(node):
    node.say("slam", "speech")
    node.refuse(node.speech)
    node.say("slam", sequence=2)
    node.kernel.allow()
    node.time.advance_by(LONG)
    said = len(node.late)
    node.time.advance_by(LONG)
    assert (len(node.late), node.late[-1]) == (said, {})


def test_a_deleted_policy_is_undone_once_that_is_possible(node):
    node.say("slam", "speech")
    node.refuse(node.speech)
    node.agent.hear(POLICY, None)
    assert node.limits() == (500, 10)
    node.kernel.allow()
    node.time.advance_by(AGAIN.first)
    assert node.limits() == (500, 500)


def test_the_journal_says_that_a_policy_is_undone_once_there_is_room(node, tmp_path):
    node.say("slam")
    node.agent.hear(OTHER, a_message(a_target(SPEECH, 0.2, task="speech"), policy=OTHER))
    node.disk.full = True
    node.agent.hear(POLICY, None)
    node.disk.full = False
    node.time.advance_by(AGAIN.first)
    journal = Ledger(tmp_path / "state" / "agent.journal")
    journal.load()
    assert {entry.policy for entry in journal.entries.values()} == {OTHER}


def test_a_killed_agents_changes_are_undone_once_that_is_possible(node):
    node.say("slam")
    heir = node.start()
    node.refuse(node.slam)
    heir.lose_source(POLICY)
    node.time.advance_by(LONG)
    assert node.tree.limit(node.slam) == 800
    node.kernel.allow()
    node.time.advance_by(LONG)
    assert node.tree.limit(node.slam) == 500


def test_new_plan_cancels_a_pending_undo(node):
    node.say("slam", "speech")
    node.refuse(node.speech)
    node.agent.hear(POLICY, None)
    node.kernel.allow()
    node.say("slam", "speech", run=2)
    node.time.advance_by(LONG)
    assert node.limits() == (800, 10)


def test_weights_that_cannot_be_put_back_are_named_and_put_back_later(node):
    before = node.tree.weight(node.speech)
    both = [a_target(SLAM, 0.8, weight=0.8), a_target(SPEECH, 0.1, task="speech", weight=0.1)]
    node.agent.hear(POLICY, a_message(*both))
    node.kernel.refuse("pwrite", node.tree.weight_file(node.speech), errno.EBUSY)
    assert failed(node.agent.hear(POLICY, a_message(both[0], sequence=2))) == {"b": "Busy"}
    node.kernel.allow()
    node.time.advance_by(AGAIN.first)
    assert node.tree.weight(node.speech) == before


def test_a_failed_weight_is_attributed_to_its_own_policy(node):
    node.agent.hear(OTHER, a_message(a_target(SPEECH, 0.1, task="speech", weight=0.1), policy=OTHER))
    node.tree.set_weight(node.speech, 77)
    node.kernel.refuse("pwrite", node.tree.weight_file(node.speech), errno.EBUSY)
    assert failed(node.agent.hear(POLICY, a_message(a_target(SLAM, 0.8, weight=0.8)))) == {}
    assert node.late == [{"b": "Busy"}]


def test_budgets_that_cannot_be_read_while_a_policy_is_undone_are_undone_later(node, monkeypatch):
    monkeypatch.setattr("contextpolicy.agent.threads.make_realtime", lambda *_: None)
    monkeypatch.setattr("contextpolicy.agent.threads.make_ordinary", lambda *_: None)
    plan(node.agent, 1.0, 0.6, scheduler="Realtime", capacity=1.9)
    top = node.tree.layout.top / node.slam_budget.name
    node.kernel.refuse("pread", top, errno.EIO)
    node.agent.hear(POLICY, None)
    node.kernel.allow()
    node.time.advance_by(AGAIN.first)
    assert node.budgets() == (0, 0)


# what fails after a plan was confirmed


def asleep(node, **more):
    """Slam works, and speech is suspended."""
    working = a_target(SLAM, 0.8, weight=0.8, quota=0.5)
    resting = a_target(SPEECH, 0.01, task="speech", weight=0, quota=0.01, held=True)
    return node.agent.hear(POLICY, a_message(working, resting, suspended=("speech",), **more))


def test_a_quota_that_fails_after_the_drain_is_written_later(node):
    assert failed(asleep(node)) == {}
    node.refuse(node.speech)
    node.time.advance_by(DRAIN)
    node.kernel.allow()
    assert (node.limits(), node.late) == ((500, 500), [{"b": "Busy"}])
    node.time.advance_by(AGAIN.first)
    assert (node.limits(), node.late[-1]) == ((500, 10), {})


def test_a_plan_that_failed_is_carried_out_later(node):
    node.refuse(node.slam)
    assert failed(node.say("slam", "speech")) == {"a": "Busy"}
    node.kernel.allow()
    node.time.advance_by(AGAIN.first)
    assert (node.limits(), node.late) == ((800, 10), [{}])


def test_a_plan_without_room_for_its_journal_is_carried_out_later(node):
    node.disk.full = True
    assert failed(node.say("slam")) == {"a": "Unsaved"}
    node.time.advance_by(LONG)
    node.disk.full = False
    node.time.advance_by(AGAIN.longest)
    assert (node.limits(), node.late[-1]) == ((800, 500), {})


def foreign_weight(node, group):
    """Another writer changes a weight, and the watch reports it."""
    node.tree.set_weight(group, 77)
    node.agent.on_other_write(node.tree.weight_file(group), monotonic())


def test_a_weight_that_cannot_be_restored_is_restored_later(node):
    asleep(node)
    node.time.advance_by(DRAIN)
    ours = node.tree.weight(node.slam)
    node.kernel.refuse("pwrite", node.tree.weight_file(node.slam), errno.EBUSY)
    foreign_weight(node, node.slam)
    node.kernel.allow()
    assert (node.tree.weight(node.slam), node.late) == (77, [{"a": "Busy"}])
    node.time.advance_by(AGAIN.first)
    assert (node.tree.weight(node.slam), node.late[-1]) == (ours, {})


def test_a_weight_that_cannot_be_read_after_a_foreign_write_is_restored_later(node):
    asleep(node)
    node.time.advance_by(DRAIN)
    ours = node.tree.weight(node.slam)
    node.kernel.refuse("pread", node.tree.weight_file(node.slam), errno.EIO)
    foreign_weight(node, node.slam)
    node.kernel.allow()
    node.time.advance_by(AGAIN.first)
    assert node.tree.weight(node.slam) == ours


def test_an_unreadable_limit_after_an_external_write_is_restored_and_undoable(node):
    node.say("slam")
    node.kernel.refuse("pread", node.slam_limit, errno.EIO)
    node.tree.set(node.slam, 500)
    node.agent.on_other_write(node.slam_limit, monotonic())
    node.kernel.allow()
    node.time.advance_by(AGAIN.first)
    assert node.tree.limit(node.slam) == 800
    node.agent.hear(POLICY, None)
    assert node.tree.limit(node.slam) == 500


def test_retry_keeps_an_external_limit_on_another_container(node):
    node.refuse(node.speech)
    node.say("slam", "speech")
    node.tree.set(node.slam, 300)
    node.agent.on_other_write(node.slam_limit, monotonic())
    node.kernel.allow()
    node.time.advance_by(AGAIN.first)
    assert node.limits() == (300, 10)


def test_a_container_that_has_ended_is_not_waited_for(node):
    node.say("slam", "speech")
    node.kernel.refuse("pread", node.slam_limit, errno.ENODEV)
    assert failed(node.say("slam", "speech", sequence=2)) == {"a": "Gone"}
    node.time.advance_by(LONG)
    assert node.late == []


def test_stopped_agent_retries_nothing(node):
    node.say("slam")
    node.refuse(node.slam)
    node.agent.stop()
    node.kernel.allow()
    node.time.advance_by(LONG)
    assert node.tree.limit(node.slam) == 800


def test_a_repeated_plan_leaves_a_value_that_another_writer_set_while_another_container_fails(node):
    node.refuse(node.speech)
    node.say("slam", "speech")
    node.tree.set(node.slam, 300)
    node.agent.on_other_write(node.slam_limit, monotonic())
    assert failed(node.say("slam", "speech")) == {"b": "Busy"}
    assert node.tree.limit(node.slam) == 300
