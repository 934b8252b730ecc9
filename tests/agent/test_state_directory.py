"""The lock between agents and their supervisor; each `StateDirectory` stands for a process."""

from __future__ import annotations

import threading
from queue import SimpleQueue

import pytest

from contextpolicy.agent.inotify import WriteWatch
from contextpolicy.agent.state_directory import StateDirectory
from contextpolicy.errors import SettingsError
from tests.waiting import PATIENCE


@pytest.fixture
def directory(tmp_path):
    return lambda: StateDirectory(tmp_path / "state")


def test_an_agent_waits_until_a_supervisor_has_undone(directory):
    supervisor, agent = directory(), directory()
    assert supervisor.take_now()
    lives: SimpleQueue[bool] = SimpleQueue()
    threading.Thread(target=lambda: lives.put(agent.begin_life(PATIENCE)), daemon=True).start()
    supervisor.release()
    assert lives.get(timeout=PATIENCE)
    assert not supervisor.take_now()


def test_an_agent_gives_up_after_a_while(directory):
    directory().take_now()
    assert not directory().begin_life(0.01)


def test_the_lock_shows_a_running_agent_and_not_a_waiting_one(directory):
    supervisor, agent = directory(), directory()
    heard: SimpleQueue[object] = SimpleQueue()

    class Listener:
        def on_write(self, path, _):
            heard.put((path, supervisor.take_now()))

    watch = WriteWatch(Listener())
    watch.add(supervisor.lock)
    assert agent.begin_life(PATIENCE)
    assert heard.get(timeout=PATIENCE) == (supervisor.lock, False)
    assert heard.empty()


def test_the_lock_is_taken_when_its_holder_lets_go(directory):
    first, second, taken = directory(), directory(), threading.Event()
    assert first.take_now()
    second.take_then(taken.set)
    assert not taken.is_set()
    first.release()
    assert taken.wait(PATIENCE)


@pytest.mark.parametrize(("journal", "left"), [(None, False), ("", False), ("{}\n", True)])
def test_a_journal_with_entries_leaves_something_to_undo(directory, journal, left):
    state = directory()
    if journal is not None:
        (state.path / "agent.journal").write_text(journal)
    assert state.anything_left is left


def test_a_directory_that_cannot_be_made_is_reported(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(SettingsError, match="STATE_DIRECTORY"):
        StateDirectory(tmp_path / "file" / "state")
