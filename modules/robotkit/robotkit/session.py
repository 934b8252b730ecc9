"""Zenoh sessions that wait for their router, survive its restart and are always closed."""

from __future__ import annotations

import json
import logging
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import zenoh

from robotkit.errors import ConfigurationError

if TYPE_CHECKING:
    import threading
    from collections.abc import Callable, Iterator, Mapping, Sequence

ATTEMPT_MS, LONGEST_MS = 1000, 4000
"""The first attempt to reach the router, and any later one at most; each is twice as long as the one before. A module
that is suspended while it starts has a hundredth of a core for its TLS handshake."""
PAUSE_S = 0.2
RETRY = {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5}
"""How often a router that is not there is tried again; Zenoh's default is 1, 2, then 4 s."""
LEASE_MS = 1000
QUEUE = 16
"""Messages queued for the network, per priority; with Zenoh's default of 2 a busy robot drops some."""
POOL = 3 << 20
"""Bytes of shared memory that a publisher makes for its frames. All of it is locked, by subscribers too: Zenoh's
default of 16 MiB is more than a container may lock (8 MiB, systemd's default), and then frames go by TCP."""
SHARED_FROM = 3072
"""Bytes: smaller payloads are sent with their message, as is Zenoh's default."""

_LOG = logging.getLogger(__name__)


def endpoints(environment: Mapping[str, str]) -> tuple[str, ...]:
    """Read the comma-separated addresses of ZENOH_CONNECT."""
    found = tuple(part.strip() for part in environment.get("ZENOH_CONNECT", "").split(",") if part.strip())
    if not found:
        raise ConfigurationError("ZENOH_CONNECT is empty: set it to the router's address, such as tcp/127.0.0.1:7447")
    return found


def credentials(environment: Mapping[str, str]) -> Path | None:
    """Read ZENOH_CREDENTIALS: the directory of a mounted Secret that authenticates us; None on an open bus."""
    text = environment.get("ZENOH_CREDENTIALS", "")
    if text and not Path(text).is_dir():
        raise ConfigurationError(
            f"ZENOH_CREDENTIALS: invalid value {text!r}: expected a directory, such as a mounted Secret"
        )
    return Path(text) if text else None


def switch(environment: Mapping[str, str], name: str, *, absent: bool = False) -> bool:
    """Whether a variable is true; `absent` where there is none."""
    value = environment.get(name, str(absent).lower())
    if value not in ("true", "false"):
        raise ConfigurationError(f"{name}: invalid value {value!r}: expected true or false")
    return value == "true"


def client_config(addresses: Sequence[str], *, shared_memory: bool = False, secret: Path | None = None) -> zenoh.Config:
    """Connect to these addresses only; a hung peer is noticed after one second, not ten.

    `secret` holds ca.crt, and either tls.crt and tls.key or username and password. With `shared_memory`, payloads of
    3 KiB and more stay in shared memory and Zenoh sends only a reference.
    """
    config = zenoh.Config()
    for key, value in (
        ("mode", "client"),
        ("connect/endpoints", list(addresses)),
        ("connect/timeout_ms", ATTEMPT_MS),
        ("connect/retry", RETRY),
        ("scouting/multicast/enabled", False),
        ("transport/link/tx/lease", LEASE_MS),
        *((f"transport/link/tx/queue/size/{priority}", QUEUE) for priority in ("real_time", "data")),
        ("transport/shared_memory/enabled", shared_memory),
        ("transport/shared_memory/transport_optimization/pool_size", POOL),
        ("transport/shared_memory/transport_optimization/message_size_threshold", SHARED_FROM),
        *(_identity(secret) if secret else ()),
    ):
        _insert(config, key, value)
    return config


def _identity(secret: Path) -> Iterator[tuple[str, object]]:
    """Settings that authenticate us. Zenoh reads certificates on each connect, so renewed ones need no restart."""
    tls = "transport/link/tls"
    if (secret / "ca.crt").is_file():
        yield f"{tls}/root_ca_certificate", str(secret / "ca.crt")
    if (secret / "tls.crt").is_file():
        yield f"{tls}/enable_mtls", True
        yield f"{tls}/close_link_on_expiration", True
        yield f"{tls}/connect_certificate", str(secret / "tls.crt")
        yield f"{tls}/connect_private_key", str(secret / "tls.key")
    if (secret / "username").is_file():
        for field, name in (("user", "username"), ("password", "password")):
            yield f"transport/auth/usrpwd/{field}", (secret / name).read_text(encoding="utf-8").rstrip("\n")


@contextmanager
def open_session(
    addresses: Sequence[str], stop: threading.Event, *, shared_memory: bool = False, secret: Path | None = None
) -> Iterator[zenoh.Session | None]:
    """Retry until a router answers; yields None when `stop` is set first."""
    # The Secret's files may come after us.
    session = _connect(lambda: client_config(addresses, shared_memory=shared_memory, secret=secret), stop)
    try:
        yield session
    finally:
        if session is not None:
            session.close()


def _connect(configure: Callable[[], zenoh.Config], stop: threading.Event) -> zenoh.Session | None:
    # Zenoh could wait by itself, but nothing could interrupt that wait, not even a signal handler.
    attempt = ATTEMPT_MS
    while not stop.is_set():
        config = configure()
        _insert(config, "connect/timeout_ms", attempt)
        try:
            return zenoh.open(config)
        except zenoh.ZError as error:
            _LOG.warning("no Zenoh router answers yet: %s", _reason(error))
            stop.wait(PAUSE_S)
            attempt = min(2 * attempt, LONGEST_MS)
    return None


def _insert(config: zenoh.Config, key: str, value: object) -> None:
    try:
        config.insert_json5(key, json.dumps(value))
    except zenoh.ZError as error:
        raise ConfigurationError(f"{key}: invalid value {value!r}: {_reason(error)}") from error


def _reason(error: zenoh.ZError) -> str:
    """What Zenoh says, without the line of its own source."""
    return str(error).partition(" at /")[0]
