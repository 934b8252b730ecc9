"""Watches the agent, and undoes what a killed one left behind unless a successor starts.

The agent is dead when its lock is free (`state_directory`). If it left entries in the journal, the next agent has the
grace period to come: it knows what to do with them. `inotify` reports when it does. Nothing polls.

The supervisor runs for good beside every agent, and almost always waits. So it imports little, and leaves the undoing
to a process that ends.
"""

from __future__ import annotations

import logging
from enum import Enum, auto
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from pathlib import Path

    from contextpolicy.agent.state_directory import StateDirectory

log = logging.getLogger(__name__)


class _Event(Enum):
    DEAD = auto()
    """No agent holds the lock; now we do."""
    CAME = auto()
    """An agent has the lock."""
    STOP = auto()


class Undoer(Protocol):
    """What undoes what the journal has."""

    def undo(self) -> bool:
        """Undo it, unless an agent lives; False when something could not be undone."""


class AgentSupervisor:
    """Listens to the writes of the agent's lock.

    `grace` is how long a killed agent's successor may take, `patience` how long the agent's end may take when both are
    asked to end; both in seconds.
    """

    def __init__(self, state: StateDirectory, undoer: Undoer, *, grace: float, patience: float) -> None:
        self._state, self._undoer = state, undoer
        self._grace, self._patience = grace, patience
        self._events = SimpleQueue[_Event]()
        self._following = False

    def on_write(self, path: Path, heard: float) -> None:  # noqa: ARG002 - the watch's signature
        """An agent has started: called from any thread."""
        self._events.put(_Event.CAME)

    def stop(self) -> None:
        """End `run`: called from any thread."""
        self._events.put(_Event.STOP)

    def run(self) -> bool:
        """Watch over one agent after the other until `stop`; False at once when something could not be undone."""
        while self._outlive():
            left = self._state.anything_left
            self._state.release()
            if left:
                log.warning("the agent died; undoing its changes in %g s unless a new one starts", self._grace)
            event = self._next(_Event.CAME, _Event.STOP, within=self._grace if left else None)
            if event is None:
                if not self._undoer.undo():
                    return False
                event = self._next(_Event.CAME, _Event.STOP)
            if event is _Event.STOP:
                break
        return self._finish()

    def _outlive(self) -> bool:
        """Wait until no agent lives, and take the lock; False when asked to stop."""
        self._follow()
        return self._next(_Event.DEAD, _Event.STOP) is _Event.DEAD

    def _follow(self) -> None:
        """Have a thread wait for the lock, unless one does."""
        if not self._following:
            self._following = True
            self._state.take_then(lambda: self._events.put(_Event.DEAD))

    def _next(self, *wanted: _Event, within: float | None = None) -> _Event | None:
        """The next event of these; None when none comes within so many seconds."""
        while True:
            try:
                event = self._events.get(timeout=within)
            except Empty:
                return None
            if event is _Event.DEAD:
                self._following = False
            if event in wanted:
                return event

    def _finish(self) -> bool:
        """The agent is asked to end too, and undoes its changes: undo what it could not, at once."""
        self._follow()
        if self._next(_Event.DEAD, within=self._patience) is None:
            log.warning("the agent is still running after %g s: leaving it to undo its own changes", self._patience)
            return True
        left = self._state.anything_left
        self._state.release()
        return self._undoer.undo() if left else True
