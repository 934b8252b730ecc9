"""A client of a router that is there."""

from __future__ import annotations

from threading import Event, Timer
from typing import TYPE_CHECKING

from contextpolicy.bus.session import open_client

if TYPE_CHECKING:
    from pathlib import Path

    import zenoh


PATIENCE = 30.0


def client_of(endpoint: str, credentials: Path | None = None) -> zenoh.Session:
    stop = Event()
    timer = Timer(PATIENCE, stop.set)
    timer.start()
    session = open_client([endpoint], stop, credentials)
    timer.cancel()
    assert session is not None, f"no router at {endpoint} within {PATIENCE:g} s"
    return session
