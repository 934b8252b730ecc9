"""Kopf's event loop on a thread of its own, so that the process can start it, end it and see it fail."""

from __future__ import annotations

from threading import Event, Thread
from typing import TYPE_CHECKING, Protocol

import kopf

from contextpolicy.app import kopf_handlers
from contextpolicy.app.kopf_reading import bound_nesting

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from contextpolicy.app.wiring import Operator


class KopfListener(Protocol):
    """Receives the end of kopf."""

    def on_kopf_end(self) -> None:
        """It has ended by itself; called on its thread."""


class KopfThread:
    """Kopf on a thread of its own, for a fixed set of namespaces."""

    def __init__(self, operator: Operator, namespaces: Collection[str], listener: KopfListener) -> None:
        self.namespaces = frozenset(namespaces)
        self.failed = False
        self._memo = kopf.Memo(operator=operator, loop=None)
        self._stop, self._listener = Event(), listener
        self._thread = Thread(target=self._run, name="kopf", daemon=True)
        self._thread.start()

    def begin_stop(self) -> None:
        """Ask it to end."""
        self._stop.set()

    def stop(self) -> None:
        """End it, and wait until no handler runs any more."""
        self.begin_stop()
        self._thread.join()

    def submit(self, beat: Callable[[], None]) -> None:
        """Call `beat` on kopf's loop; at once before there is one, and after it was ended."""
        loop = self._memo.loop
        try:
            if loop is not None:
                loop.call_soon_threadsafe(beat)
                return
        except RuntimeError:  # it is closed
            pass
        beat()

    def _run(self) -> None:
        bound_nesting()
        try:
            kopf.run(
                registry=kopf_handlers.registry,
                standalone=True,
                namespaces=sorted(self.namespaces),
                stop_flag=self._stop,
                memo=self._memo,
            )
        finally:
            self.failed = not self._stop.is_set()
            if self.failed:
                self._listener.on_kopf_end()
