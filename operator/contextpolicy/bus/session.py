"""Zenoh sessions with bounds: no multicast, quick detection of dead peers, a start that can be stopped."""

from __future__ import annotations

import json
import logging
from typing import TYPE_CHECKING

import zenoh

if TYPE_CHECKING:
    from collections.abc import Sequence
    from threading import Event

log = logging.getLogger(__name__)

ATTEMPT = 1.0
"""Seconds."""
QUEUE = 16
"""Messages that wait for the network, per priority; the most that Zenoh allows. With its default of 2, two
busy cores lost 3 % of 200 samples a second and 5 % of the plans: a message that finds no place for 1 ms is dropped."""
PRIORITIES = (
    *("control", "real_time", "interactive_high", "interactive_low", "data_high", "data", "data_low", "background"),
)
LEASE_MS = 1000
"""A hung peer is declared dead within this; the default of 10 s is longer than a robot can wait."""


def open_client(endpoints: Sequence[str], stop: Event) -> zenoh.Session | None:
    """A client of the router at `endpoints`, as soon as it answers; None when `stop` is set first.

    Zenoh could wait by itself, but then nothing could end the wait; an open session reconnects by itself.
    """
    while not stop.is_set():
        try:
            return open_visitor(endpoints, patience=ATTEMPT)
        except zenoh.ZError as error:
            log.warning("no Zenoh router at %s yet: %s", ", ".join(endpoints), error)
            stop.wait(ATTEMPT)
    return None


def open_visitor(endpoints: Sequence[str], *, patience: float) -> zenoh.Session:
    """A client for one question, of a person who waits: zenoh.ZError when no router answers for `patience` seconds."""
    settings = {"mode": "client", "connect/endpoints": list(endpoints), "connect/timeout_ms": int(patience * 1000)}
    return zenoh.open(_config(settings))


def open_router(endpoints: Sequence[str]) -> zenoh.Session:
    """A session that routes between its clients, at `endpoints`."""
    return zenoh.open(_config({"mode": "router", "listen/endpoints": list(endpoints)}))


def _config(settings: dict[str, object]) -> zenoh.Config:
    config = zenoh.Config()
    common: dict[str, object] = {"scouting/multicast/enabled": False, "transport/link/tx/lease": LEASE_MS}
    queues = {f"transport/link/tx/queue/size/{priority}": QUEUE for priority in PRIORITIES}
    for key, value in {**common, **queues, **settings}.items():
        config.insert_json5(key, json.dumps(value))
    return config
