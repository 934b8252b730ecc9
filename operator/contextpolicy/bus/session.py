"""Zenoh sessions with bounds: no multicast, fast detection of dead peers, a start that can be interrupted."""

from __future__ import annotations

import json
import logging
from typing import TYPE_CHECKING

import zenoh

from contextpolicy.bus.credentials import USERS, client_settings, router_settings, uplink_settings
from contextpolicy.bus.questions import LARGEST_QUESTION
from contextpolicy.bus.roles import OWN, access_control, fleet_access_control

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path
    from threading import Event

log = logging.getLogger(__name__)

ATTEMPT, LONGEST = 0.5, 4.0
"""Seconds for which the first attempt to connect tries again and again, and any later one at most.

A connection that goes nowhere, as while a node starts, takes up a whole attempt, so the first is short. Each later one
is twice as long: on a slow or busy board a TLS handshake may take seconds."""
PAUSE = 0.2
"""Seconds before the next attempt: one with an address that is none fails at once."""
RETRY = {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5}
"""How often a client tries to reach a router that is not there, at first and after it was lost. With Zenoh's default
(1, 2, 4 s) a robot that is switched on waits for seconds beside a router that has started."""
QUEUE = 16
"""Messages queued for the network, per priority; the most that Zenoh allows. With its default of 2, two busy cores
lost 3 % of 200 samples a second and 5 % of the plans: Zenoh drops a message that finds no place within 1 ms."""
PRIORITIES = (
    *("control", "real_time", "interactive_high", "interactive_low", "data_high", "data", "data_low", "background"),
)
DROP_AFTER = "transport/link/tx/queue/congestion_control/drop/wait_before_drop"
"""In microseconds."""
ROUTER_KEEP = 0.05
"""Seconds that a message waits for a place in a router's full queue before it is dropped, and at once what follows it
until the queue has a place again. With Zenoh's default, a burst of 20,000 small samples lost a third of them on two
busy cores; with 20 ms none."""
CLOSE_AFTER = 0.25
"""Seconds that a router waits for a client that reads nothing, before it closes its session, with what Zenoh never
drops: who declared what. Some MB of that wait by then. All others wait as long; with Zenoh's default, for 5 s."""
LARGEST = 8 << 20
"""Bytes of a message that a router passes on at most: a raw camera frame of 1920 x 1080 has 6 MB. A router gathers 14
long messages of each session at a time, one of each priority and reliability."""
HEADERS = 64 << 10
"""Bytes of a message besides its payload and attachment, at most: its key has up to as many."""
LARGEST_WORD = 256 << 10
"""Bytes of what an agent says about its node: some 100 pods take a tenth of that."""
ENTER_MS, ENTERING = 2000, 1000
"""How long a client that reached a router may take to open its session, and how many may be at it. With Zenoh's
defaults (10 s, 100), a hundred silent links that come again at once keep everybody else out."""
SESSIONS = 1000
"""That a router has at most."""
LEASE_MS = 1000
"""A hung peer is declared dead within this time; the default of 10 s is longer than a robot can wait."""


def open_client(endpoints: Sequence[str], stop: Event, credentials: Path | None = None) -> zenoh.Session | None:
    """Block until the router at `endpoints` answers, and return a client of it; None when `stop` is set first.

    Zenoh could wait by itself, but nothing could interrupt it: `stop` is heard after an attempt. Once open, a session
    reconnects by itself.
    """
    patience = ATTEMPT
    while not stop.is_set():
        try:
            return open_visitor(endpoints, patience=patience, credentials=credentials)
        except zenoh.ZError as error:
            log.warning("no Zenoh router at %s yet: %s", ", ".join(endpoints), reason(error))
            stop.wait(PAUSE)
            patience = min(2 * patience, LONGEST)
    return None


def reason(error: zenoh.ZError) -> str:
    """What Zenoh says, without its repetition of the endpoints and the line of its own source."""
    return str(error).partition(" at /")[0].rpartition("]. ")[2]


def open_visitor(endpoints: Sequence[str], *, patience: float, credentials: Path | None = None) -> zenoh.Session:
    """A client for one-off queries from the command line; zenoh.ZError when no router answers in `patience` seconds.

    `credentials` is a directory (see `bus.credentials`), or None on a bus that is open to all.
    """
    settings = {
        "mode": "client",
        "connect/endpoints": list(endpoints),
        "connect/timeout_ms": int(patience * 1000),
        "connect/retry": RETRY,
    }
    return zenoh.open(_config({**settings, **client_settings(credentials)}))


def open_router(
    endpoints: Sequence[str],
    credentials: Path | None = None,
    samples: Sequence[str] = (),
    *,
    uplink: Sequence[str] = (),
    largest: int = LARGEST,
) -> zenoh.Session:
    """A router that listens at `endpoints`.

    With `credentials` it admits only clients with a role and enforces the rights of that role (`bus.roles`), with
    samples on the keys `samples` (none: on all but our own); it then may join a fleet's router at one of the endpoints
    `uplink`. Without credentials it accepts anything from anybody, but for messages of more than `largest` bytes.
    """
    settings: dict[str, object] = {**_router(endpoints), **_bounds(largest)}
    if credentials is not None:
        by = "usernames" if (credentials / USERS).is_file() else "cert_common_names"
        settings |= {**router_settings(credentials), "access_control": access_control(samples, by=by)}
        if uplink:
            settings |= {"connect/endpoints": list(uplink), **uplink_settings(credentials)}
    return zenoh.open(_config(settings))


def open_fleet_router(endpoints: Sequence[str], credentials: Path) -> zenoh.Session:
    """A router that robots' routers join: holders of a viewer's certificate see their plans."""
    rights = {**router_settings(credentials), "access_control": fleet_access_control(), **_bounds(LARGEST)}
    return zenoh.open(_config({**_router(endpoints), **rights}))


def _router(endpoints: Sequence[str]) -> dict[str, object]:
    """No router waits for a slow reader: one that is suspended or hangs would hold up everybody else's messages.

    A sender may ask to block when congested, as ROS nodes do, and every query does so by default. A router that
    honours it waits up to 5 s for the one that does not read, routes nothing meanwhile, and was seen to wait for ever.
    Replies go out as their query came in. There are no `key_exprs` here: `**` leaves out keys with an @, such as those
    of latched topics.
    """
    sent = {"id": "sent", "flows": ["ingress"], "messages": ["put", "delete", "query"]}
    return {
        "mode": "router",
        "listen/endpoints": list(endpoints),
        "qos/network": [{**sent, "overwrite": {"congestion_control": "drop"}}],
        DROP_AFTER: int(ROUTER_KEEP * 1e6),
        "transport/link/tx/queue/congestion_control/block/wait_before_close": int(CLOSE_AFTER * 1e6),
        "transport/unicast/accept_timeout": ENTER_MS,
        "transport/unicast/accept_pending": ENTERING,
        "transport/unicast/max_sessions": SESSIONS,
        # Else it lets clients in for 0.5 s before it says that it routes, and killed then, seems never to have routed.
        "scouting/delay": 0,
    }


def _bounds(largest: int) -> dict[str, object]:
    """The router drops what is larger, before it takes memory of those who listen.

    A filter counts for the keys that one of its own includes. So a question on `**` or `*/agents/*` may be as large as
    any message: rights keep it from operators and agents (`bus.roles`), and on a bus that is open to all they end it.
    """
    latched = "**/@adv/**"  # which `**` leaves out
    filters = [
        _filter("messages", ["put", "delete", "query", "reply"], ["**", latched], largest),
        _filter("agents", ["put", "delete", "reply"], [f"{OWN}/agents/**"], min(largest, LARGEST_WORD)),
        _filter("questions", ["query"], [f"{OWN}/**"], min(largest, LARGEST_QUESTION)),
    ]
    # The filter sees whole messages only: until then Zenoh would gather up to 1 GiB.
    return {"low_pass_filter": filters, "transport/link/rx/max_message_size": largest + HEADERS}


def _filter(name: str, messages: list[str], keys: list[str], largest: int) -> dict[str, object]:
    return {"id": name, "flows": ["ingress"], "messages": messages, "key_exprs": keys, "size_limit": largest}


def _config(settings: dict[str, object]) -> zenoh.Config:
    config = zenoh.Config()
    common: dict[str, object] = {"scouting/multicast/enabled": False, "transport/link/tx/lease": LEASE_MS}
    queues = {f"transport/link/tx/queue/size/{priority}": QUEUE for priority in PRIORITIES}
    for key, value in {**common, **queues, **settings}.items():
        config.insert_json5(key, json.dumps(value))
    return config
