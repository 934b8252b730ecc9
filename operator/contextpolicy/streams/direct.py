"""Callbacks on Zenoh's own thread.

By default zenoh-python queues up to 256 messages, of whatever size, for a thread of its own that calls back: a sender
of large messages fills the memory before any of them can be inspected. Called directly, the callback holds back the
link instead, and the sender's side drops what does not fit. It must not block.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from zenoh.handlers import Callback

if TYPE_CHECKING:
    from collections.abc import Callable

Message = TypeVar("Message")


def directly(callback: Callable[[Message], None]) -> Callback[Message]:
    """The handler to declare."""
    return Callback(callback, indirect=False)
