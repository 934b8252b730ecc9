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


class _Kept(threading.local):
    """Whether Python keeps its state of this thread; forgotten with that state."""

    already = False


_kept = _Kept()


def directly(callback: Callable[[Message], None]) -> Callback[Message]:
    """The handler to declare."""

    def call(message: Message) -> None:
        if not _kept.already:
            _keep_state()
        callback(message)

    return Callback(call, indirect=False)


def _keep_state() -> None:
    """Have Python keep its state of this thread, which it did not start, when the callback returns.

    Otherwise each callback maps 16 KiB for the stack of a new state and unmaps it again, which interrupts all threads:
    a third of what a sample costs. Zenoh has a few such threads, and ends none before the process does.
    """
    ctypes.pythonapi.PyGILState_Ensure()
    _kept.already = True
