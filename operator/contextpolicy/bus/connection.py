"""Whether a session has a router: Zenoh reports each transport that opens or closes, so nothing polls."""

from __future__ import annotations

from threading import Lock
from typing import Protocol

import zenoh


class ConnectionListener(Protocol):
    """Receives changes of the connection."""

    def on_connection(self, *, connected: bool) -> None:
        """The router connected or disconnected; called on a thread of Zenoh's, and once at the start."""


class Connection:
    """Reports whenever that changes, and once at the start.

    A router that ends is noticed within milliseconds, one that hangs after the lease of `bus.session`, a second.
    """

    def __init__(self, session: zenoh.Session, listener: ConnectionListener) -> None:
        self._listener = listener
        self._open: set[str] = set()
        self._lock = Lock()
        self._told: bool | None = None
        self._events = session.info.declare_transport_events_listener(self._on_event, history=True)
        self._tell()

    def close(self) -> None:
        """Stop listening."""
        self._events.undeclare()

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
                self._listener.on_connection(connected=connected)
