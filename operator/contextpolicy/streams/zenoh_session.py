"""Zenoh sessions with bounds: no multicast, quick detection of dead peers, no start that waits for ever."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import zenoh

if TYPE_CHECKING:
    from collections.abc import Sequence

LEASE_MS = 1000
"""A hung peer is declared dead within this; the default of 10 s is longer than a robot can wait."""


def open_client(endpoints: Sequence[str]) -> zenoh.Session:
    """Use the router at `endpoints`; opens at once, also while the router or its name can't be reached yet.

    A session in client mode would wait for the connection, without end when the name does not resolve; a peer that
    neither listens nor gossips is as good a client, connects in the background and again after every loss.
    """
    return zenoh.open(
        _config(
            {
                "mode": "peer",
                "listen/endpoints": [],
                "connect/endpoints": list(endpoints),
                "connect/timeout_ms": -1,
                "connect/exit_on_failure": False,
                "scouting/gossip/enabled": False,
            }
        )
    )


def open_visitor(endpoints: Sequence[str], *, patience: float) -> zenoh.Session:
    """A client for one question, of a person who waits: zenoh.ZError when no router answers for `patience` seconds."""
    return zenoh.open(
        _config(
            {
                "mode": "client",
                "connect/endpoints": list(endpoints),
                "connect/timeout_ms": int(patience * 1000),
                "connect/exit_on_failure": True,
            }
        )
    )


def open_router(endpoints: Sequence[str]) -> zenoh.Session:
    """A session that routes between its clients, at `endpoints`."""
    return zenoh.open(_config({"mode": "router", "listen/endpoints": list(endpoints)}))


def _config(settings: dict[str, object]) -> zenoh.Config:
    config = zenoh.Config()
    common: dict[str, object] = {"scouting/multicast/enabled": False, "transport/link/tx/lease": LEASE_MS}
    for key, value in {**common, **settings}.items():
        config.insert_json5(key, json.dumps(value))
    return config
