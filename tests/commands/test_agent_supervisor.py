"""The supervisor as a program, beside agents that are processes and die."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from queue import SimpleQueue

import pytest
import zenoh

from contextpolicy.agent.state_directory import StateDirectory
from contextpolicy.bus.decision_bus import agent_key
from contextpolicy.bus.session import open_router
from tests.agent.builders import NODE, SLAM, SPEECH, Tree
from tests.ports import free_port
from tests.waiting import PATIENCE, until

LONG = 3600.0
"""A grace period that no test waits for."""
ENDLESS = -1


class Node:
    """Two containers, and the programs beside them."""

    def __init__(self, tmp_path):
        self.tree, self.state = Tree(tmp_path / "cgroup"), tmp_path / "state"
        self._groups = [self.tree.container(SLAM), self.tree.container(SPEECH)]
        self.started = []

    def agent(self, plans=3):
        """Start an agent that carries out so many plans."""
        return self._start("tests.agent.mortal", self.tree.mount, self.state, plans)

    def busy(self, plans=3):
        """Start an agent that has carried them out."""
        agent = self.agent(plans)
        printed(agent, plans)
        return agent

    def supervisor(self, *arguments, grace=0.0):
        """Start a supervisor that watches."""
        supervisor = self.run("agent-supervisor", f"--grace={grace}", *arguments)
        said(supervisor, "watching")
        return supervisor

    def run(self, *arguments):
        return self._start("contextpolicy", *arguments)

    def limits(self):
        return [self.tree.limit(group) for group in self._groups]

    def undone(self):
        """Whether all is as it was, and no agent has to know."""
        return self.limits() == [500, 500] and not StateDirectory(self.state).anything_left

    def kill(self):
        """End all programs, which ends any wait for what they say."""
        for process in self.started:
            process.kill()

    def _start(self, module, *arguments):
        places = {"CGROUP_ROOT": str(self.tree.mount), "STATE_DIRECTORY": str(self.state)}
        command = [sys.executable, "-m", module, *map(str, arguments)]
        pipe, environment = subprocess.PIPE, os.environ | places
        self.started.append(subprocess.Popen(command, env=environment, stdout=pipe, stderr=pipe, text=True))
        return self.started[-1]


@pytest.fixture
def node(tmp_path):
    node = Node(tmp_path)
    bound = threading.Timer(2 * PATIENCE, node.kill)
    bound.start()
    yield node
    bound.cancel()
    node.kill()
    for process in node.started:
        process.communicate()


def kill(process):
    process.kill()
    process.wait(PATIENCE)


def ask_to_end(process):
    process.send_signal(signal.SIGTERM)


def printed(agent, word):
    """Wait until it prints that it is here, or the number of a plan that it carried out."""
    assert f"{word}\n" in agent.stdout


def said(process, text):
    """Wait until it logs a line with the text."""
    assert any(text in line for line in process.stderr), f"it never said {text}"


@pytest.mark.parametrize("plan", [1, 2, 3, 40, 200])
def test_agent_killed_after_any_plan_is_undone(node, plan):
    node.supervisor()
    agent = node.agent(ENDLESS)
    printed(agent, plan)
    kill(agent)
    until(node.undone)


def test_nothing_is_undone_within_the_grace_period(node):
    supervisor = node.supervisor(grace=LONG)
    kill(node.busy())
    said(supervisor, "the agent died")
    wanted = node.limits()
    assert wanted != [500, 500]
    following = node.busy()
    assert node.limits() == wanted
    ask_to_end(following)
    assert following.wait(PATIENCE) == 0
    assert node.undone()
    ask_to_end(supervisor)
    _, error = supervisor.communicate(timeout=PATIENCE)
    assert (supervisor.returncode, error) == (0, ""), "it did something"


def test_each_killed_agent_is_undone_in_turn(node):
    node.supervisor()
    for _ in range(3):
        kill(node.busy())
        until(node.undone)


def test_an_agent_that_came_within_the_grace_period_and_died_is_undone(node):
    node.supervisor(grace=1.0)
    first = node.busy()
    second = node.agent()
    printed(second, "here")
    kill(first)
    printed(second, 3)
    assert node.limits() != [500, 500]
    kill(second)
    until(node.undone)


def test_a_supervisor_that_starts_after_the_agents_death_undoes_it(node):
    kill(node.busy())
    node.supervisor()
    until(node.undone)


def test_restarted_supervisor_continues_for_a_killed_one(node):
    supervisor, agent = node.supervisor(grace=LONG), node.busy()
    kill(supervisor)
    again = node.supervisor(grace=LONG)
    kill(agent)
    said(again, "the agent died")
    kill(again)
    node.supervisor()
    until(node.undone)


@pytest.mark.parametrize("agent_first", [True, False])
def test_agent_and_supervisor_stop_together_in_any_order(node, agent_first):
    agent, supervisor = node.busy(), node.supervisor(grace=LONG)
    for process in (agent, supervisor) if agent_first else (supervisor, agent):
        ask_to_end(process)
    assert [agent.wait(PATIENCE), supervisor.wait(PATIENCE)] == [0, 0]
    assert node.undone()


@pytest.mark.parametrize("killed_first", [True, False])
def test_stopping_supervisor_undoes_a_killed_agent_at_once(node, killed_first):
    agent, supervisor = node.busy(), node.supervisor(grace=LONG)
    for end in (kill, None) if killed_first else (None, kill):
        end(agent) if end else ask_to_end(supervisor)
    assert supervisor.wait(PATIENCE) == 0
    assert node.undone()


def test_stopping_supervisor_keeps_the_limits_of_a_live_agent(node):
    node.busy()
    wanted = node.limits()
    supervisor = node.supervisor("--patience=0.1")
    ask_to_end(supervisor)
    said(supervisor, "the agent is still running")
    assert supervisor.wait(PATIENCE) == 0
    assert node.limits() == wanted


def test_undo_does_nothing_while_an_agent_runs(node):
    node.busy()
    wanted = node.limits()
    assert node.run("agent-supervisor", "--undo").wait(PATIENCE) == 0
    assert node.limits() == wanted


def test_an_unwritable_journal_is_reported_and_retried(node):
    kill(node.busy())
    (node.state / "agent.new").mkdir()
    assert node.supervisor().wait(PATIENCE) == 1
    assert node.limits() == [500, 500]
    (node.state / "agent.new").rmdir()
    node.supervisor()
    until(node.undone)


def test_a_journal_that_cannot_be_read_is_reported_once(node):
    kill(node.busy())
    (node.state / "agent.journal").write_text("garbage\n")
    assert node.run("agent-supervisor", "--undo").wait(PATIENCE) == 1
    assert node.run("agent-supervisor", "--undo").wait(PATIENCE) == 0


def test_truncated_last_journal_line_does_not_prevent_undo(node):
    kill(node.busy())
    journal = node.state / "agent.journal"
    journal.write_text(journal.read_text() + '["/sys/fs')
    assert node.run("agent-supervisor", "--undo").wait(PATIENCE) == 0
    assert node.undone()


def test_unusable_state_directory_is_an_error(node):
    node.state.write_text("a file")
    supervisor = node.run("agent-supervisor")
    _, error = supervisor.communicate(timeout=PATIENCE)
    assert supervisor.returncode == 2
    assert "STATE_DIRECTORY" in error


def test_operator_sees_a_token_after_an_undo(node, monkeypatch):
    """An agent that was frozen is no news to it when it dies: it sees one that comes and goes."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    seen: SimpleQueue[zenoh.SampleKind] = SimpleQueue()
    kill(node.busy())
    monkeypatch.setenv("NODE_NAME", NODE)
    monkeypatch.setenv("ZENOH_CONNECT", endpoint)
    with open_router([endpoint]) as router:
        tokens = router.liveliness().declare_subscriber(agent_key(NODE), lambda token: seen.put(token.kind))
        assert node.run("agent-supervisor", "--undo").wait(PATIENCE) == 0
        kinds = [seen.get(timeout=PATIENCE) for _ in range(2)]
        tokens.undeclare()
    assert kinds == [zenoh.SampleKind.PUT, zenoh.SampleKind.DELETE]
    assert node.undone()


def test_undo_works_without_a_router(node, monkeypatch):
    kill(node.busy())
    monkeypatch.setenv("NODE_NAME", NODE)
    monkeypatch.setenv("ZENOH_CONNECT", f"tcp/127.0.0.1:{free_port()}")
    undoing = node.run("agent-supervisor", "--undo")
    said(undoing, "could not report to the operator")
    assert undoing.wait(PATIENCE) == 0
    assert node.undone()
