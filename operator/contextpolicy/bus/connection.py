"""Whether a session has a router: Zenoh tells each time that a transport opens or closes, so nothing asks."""

from __future__ import annotations

from threading import Lock
from typing import TYPE_CHECKING

import zenoh

if TYPE_CHECKING:
    from collections.abc import Callable


class Connection:
    """Calls `on_change(connected)`, on a thread of Zenoh's, whenever that changes, and once at the start.

    A router that ends is noticed within milliseconds, one that hangs after the lease of `bus.session`, a second.
    """

    def __init__(self, session: zenoh.Session, on_change: Callable[[bool], object]) -> None:
        self._on_change = on_change
        self._open: set[str] = set()
        self._lock = Lock()
        self._told: bool | None = None
        self._listener = session.info.declare_transport_events_listener(self._on_event, history=True)
        self._tell()

    def close(self) -> None:
        """Stop listening."""
        self._listener.undeclare()

    def _on_event(self, event: zenoh.TransportEvent) -> None:
        change = self._open.add if event.kind == zenoh.SampleKind.PUT else self._open.discard
        with self._lock:
            change(str(event.transport.zid))
        self._tell()

    def _tell(self) -> None:
        """Under the lock, so that the last word is the newest."""
        with self._lock:
            connected = bool(self._open)
            if connected is not self._told:
                self._told = connected
                self._on_change(connected)
