"""Whether a router still routes: its port is open for as long as the process lives, whatever hangs in it.

Zenoh tries every way to divide a key among the wildcards of another, such as `a$*a$*a$*b`, so a client that declares
one and publishes another may keep a thread busy for good. Who declares anything then waits for that thread, and all
others for him. No setting of Zenoh's bounds that, so a router declares something itself, again and again.
"""

from __future__ import annotations

from contextlib import suppress
from threading import Event, Thread
from typing import TYPE_CHECKING, Protocol

import zenoh

if TYPE_CHECKING:
    from types import TracebackType

EVERY = 1.0
"""Seconds between two declarations."""
MOST_MISSED = 5
"""How often in a row none may have been made within EVERY: a machine may be busy, or have been asleep."""
KEY = "@contextpolicy/router"
"""What is declared: a name for a key, which no other client hears of."""


class HangListener(Protocol):
    """What hears of it."""

    def on_hang(self) -> None:
        """The router hangs; called on a thread of the watch."""


class RouterWatch:
    """Watches the router of a session while it is entered."""

    def __init__(self, session: zenoh.Session, listener: HangListener) -> None:
        self._session, self._listener = session, listener
        self._stop, self._alive = Event(), Event()

    def __enter__(self) -> None:
        for work in (self._declare, self._look):
            Thread(target=work, daemon=True).start()

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._stop.set()

    def _declare(self) -> None:
        with suppress(zenoh.ZError):  # the session is closed
            while not self._stop.is_set():
                self._session.undeclare(self._session.declare_keyexpr(KEY))
                self._alive.set()
                self._stop.wait(EVERY)
        self._stop.set()

    def _look(self) -> None:
        missed = 0
        while not self._stop.wait(EVERY):
            missed = 0 if self._alive.is_set() else missed + 1
            self._alive.clear()
            if missed >= MOST_MISSED:
                self._listener.on_hang()
                return
