"""The order in which the supervisor waits; `tests/commands` has it beside agents that die."""

from __future__ import annotations

from contextpolicy.agent.agent_supervisor import AgentSupervisor
from contextpolicy.agent.state_directory import StateDirectory


class FreeLock(StateDirectory):
    """That of a node without an agent."""

    anything_left = False

    def __init__(self):
        self.threads = 0

    def take_then(self, then):
        self.threads += 1
        then()

    def release(self):
        """Nobody else wants it."""


class Undoer:
    def undo(self):
        raise AssertionError("nothing is left to be undone")


def test_one_thread_at_a_time_waits_for_the_lock():
    state = FreeLock()
    supervisor = AgentSupervisor(state, Undoer(), grace=0.0, patience=0.0)
    supervisor.stop()
    assert supervisor.run()
    assert state.threads == 1
