"""What a supervisor does in place of an agent that does not come."""

from __future__ import annotations

import errno

import pytest
from reactivex.scheduler import VirtualTimeScheduler

from contextpolicy.agent.inotify import WriteWatch
from contextpolicy.agent.leftovers import undo
from tests.agent.builders import SLAM, SPEECH, Tree, a_message, a_target, agent_settings, an_agent


@pytest.fixture
def tree(tmp_path):
    return Tree(tmp_path / "cgroup")


@pytest.fixture
def state(tmp_path):
    return tmp_path / "state"


@pytest.fixture
def groups(tree, state):
    """Two containers, which a killed agent limited for two policies."""
    groups = [tree.container(SLAM), tree.container(SPEECH)]
    agent = an_agent(tree, state, VirtualTimeScheduler())
    agent.start()
    for policy, identity in (("robot/delivery", SLAM), ("robot/guide", SPEECH)):
        agent.find_source(policy)
        agent.hear(policy, a_message(a_target(identity, 0.1), policy=policy))
    assert [tree.limit(group) for group in groups] == [100, 100]
    return groups


def test_every_policy_is_undone_at_once(tree, state, groups):
    undo(agent_settings(tree.mount, state, grace=3600))
    assert [tree.limit(group) for group in groups] == [500, 500]
    assert (state / "agent.journal").read_text() == ""


def test_confirmed_limits_are_undone_too(tree, state, groups):
    """Nobody knows whether the operator lives. If it does, it has the kubelet write the API's limits once more."""
    heir = an_agent(tree, state, VirtualTimeScheduler())
    heir.start()
    heir.hear("robot/delivery", a_message(a_target(SLAM, 0.1, limit=0.1)))
    undo(agent_settings(tree.mount, state))
    assert [tree.limit(group) for group in groups] == [500, 500]
    assert (state / "agent.journal").read_text() == ""


def test_exhausted_inotify_watches_do_not_prevent_undo(tree, state, groups, monkeypatch):
    monkeypatch.setattr(WriteWatch, "_checked", no_space)
    undo(agent_settings(tree.mount, state))
    assert [tree.limit(group) for group in groups] == [500, 500]


def no_space(*_):
    raise OSError(errno.EMFILE, "too many open files")
