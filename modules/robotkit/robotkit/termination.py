"""The end that a program is asked for, by SIGTERM or SIGINT."""

from __future__ import annotations

import signal
import socket
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

SIGNALS = (signal.SIGTERM, signal.SIGINT)


def stop_on_signals(then: Callable[[], None] = lambda: None) -> threading.Event:
    """An event that a signal sets at once, whatever the main thread is doing; `then` is called on a thread of its own.

    Python's handlers run on the main thread between two bytecodes, where it may hold a lock, the event's too, or be
    stuck in a library. So the interpreter's C handler writes into a socket (`set_wakeup_fd`), and a thread reads the
    other end.
    """
    stop = threading.Event()
    reader, writer = socket.socketpair()
    writer.setblocking(False)  # noqa: FBT003 - it has no other form
    signal.set_wakeup_fd(writer.fileno())
    for number in SIGNALS:
        signal.signal(number, lambda *_: None)

    def wait(ends: tuple[socket.socket, socket.socket]) -> None:
        # For ever: a closed end's number may become another file's, into which the next signal would write.
        while ends[0].recv(1):
            stop.set()
            then()

    threading.Thread(target=wait, args=((reader, writer),), name="signals", daemon=True).start()
    return stop
