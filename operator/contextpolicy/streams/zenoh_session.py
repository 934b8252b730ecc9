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
    """A client of the router at `endpoints`; opens within seconds even without a router and keeps trying."""
    return zenoh.open(
        _config(
            {
                "mode": "client",
                "connect/endpoints": list(endpoints),
                "connect/timeout_ms": -1,
                "connect/exit_on_failure": False,
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
