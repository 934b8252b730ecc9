"""Realtime budgets, periods and threads that can't be set."""

from __future__ import annotations

import errno

import pytest

from contextpolicy.agent import threads
from contextpolicy.errors import ActuationError
from tests.agent.builders import (
    LAYOUTS,
    POLICY,
)
from tests.agent.failing_writes.node import REASONS, failed, realtime


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
