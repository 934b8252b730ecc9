"""The end that a program is asked for, by SIGTERM or SIGINT."""

from __future__ import annotations

import signal
import threading
from queue import SimpleQueue
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

SIGNALS = (signal.SIGTERM, signal.SIGINT)


def stop_on_signals(then: Callable[[], None] = lambda: None) -> threading.Event:
    """An event that is set when the program is asked to end; `then` is called on another thread.

    Python runs a handler on the main thread, between any two bytecodes: also where that thread holds the lock of the
    event that it begins to wait for. A handler that set the event would wait for that lock, and so for itself. So a
    thread sets it; a SimpleQueue may be put into at any point.
    """
    stop, asked = threading.Event(), SimpleQueue[int]()
    for number in SIGNALS:
        signal.signal(number, lambda number, _: asked.put(number))

    def wait() -> None:
        asked.get()
        stop.set()
        then()

    threading.Thread(target=wait, name="signals", daemon=True).start()
    return stop
