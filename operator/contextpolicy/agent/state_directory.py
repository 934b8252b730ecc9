"""What lasts from one agent to the next: the journal, and a lock on it that says whether an agent lives.

The lock is the kernel's (flock). However its holder ends, it is free at once, and a waiter wakes. An agent
holds it for life; its supervisor takes it to wait for the agent's death, and to undo what the dead agent left.
"""

from __future__ import annotations

import fcntl
import os
import threading
from contextlib import suppress
from typing import TYPE_CHECKING

from contextpolicy.errors import Finding, SettingsError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

_JOURNAL, _LOCK = "agent.journal", "agent.lock"


class StateDirectory:
    """One process's view of the directory, with its hold on the lock."""

    def __init__(self, path: Path) -> None:
        """Create what is missing; SettingsError where that can't be done."""
        self.path, self.lock = path, path / _LOCK
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._descriptor = os.open(self.lock, os.O_RDONLY | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError as error:
            allowed = f"a directory where files can be created and written ({error.strerror})"
            raise SettingsError("environment", (Finding("STATE_DIRECTORY", str(path), allowed),)) from error

    @property
    def anything_left(self) -> bool:
        """Whether the journal has entries: it is emptied when nothing is left to undo."""
        with suppress(FileNotFoundError):
            return (self.path / _JOURNAL).stat().st_size > 0
        return False

    def take_then(self, then: Callable[[], None]) -> None:
        """Take the lock once it is free, and call `then`: both on a thread of their own."""

        def take() -> None:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX)
            then()

        threading.Thread(target=take, name="lock", daemon=True).start()

    def take_now(self) -> bool:
        """Take the lock if it is free."""
        with suppress(BlockingIOError):
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
        return False

    def release(self) -> None:
        """Let others take the lock."""
        fcntl.flock(self._descriptor, fcntl.LOCK_UN)

    def begin_life(self, patience: float) -> bool:
        """Take the lock for the rest of this process, and wake the supervisor; False after `patience` seconds in vain.

        To open the lock for writing and to close it is what `inotify` reports. It takes no disk space.
        """
        taken = threading.Event()
        self.take_then(taken.set)
        if not taken.wait(patience):
            return False
        os.close(os.open(self.lock, os.O_WRONLY | os.O_CLOEXEC))
        return True
