"""Callbacks on Zenoh's own thread.

By default zenoh-python queues up to 256 messages, of whatever size, for a thread of its own that calls back: a sender
of large messages fills the memory before any of them can be inspected. Called directly, the callback holds back the
link instead, and the sender's side drops what does not fit. It must not block.
"""

from __future__ import annotations

import ctypes
import threading
from typing import TYPE_CHECKING, TypeVar

from zenoh.handlers import Callback

if TYPE_CHECKING:
    from collections.abc import Callable

Message = TypeVar("Message")


class _ThreadState(threading.local):
    """Python's state of each thread that it did not start."""

    kept = False
    """Whether Python keeps it; forgotten with the state."""

    def keep(self) -> None:
        """Keep it when the callback returns.

        Otherwise each callback maps 16 KiB for the stack of a new state and unmaps it again, which interrupts all
        threads (docs/decisions/python-hot-path.md). Zenoh has a few such threads for a session, and keeps them.
        """
        ctypes.pythonapi.PyGILState_Ensure()
        self.kept = True


_state = _ThreadState()


def directly(callback: Callable[[Message], None]) -> Callback[Message]:
    """The handler to declare."""

    def call(message: Message) -> None:
        if not _state.kept:
            _state.keep()
        callback(message)

    return Callback(call, indirect=False)
