"""A client of a router that is there."""

from __future__ import annotations

from threading import Event
from typing import TYPE_CHECKING

from contextpolicy.bus.session import open_client

if TYPE_CHECKING:
    from pathlib import Path

    import zenoh


def client_of(endpoint: str, credentials: Path | None = None) -> zenoh.Session:
    session = open_client([endpoint], Event(), credentials)
    assert session is not None
    return session
