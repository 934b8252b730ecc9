"""The expiry of a program's certificate for the bus, as a metric."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from prometheus_client import Gauge

from contextpolicy.bus.credentials import CERTIFICATE, KEY
from contextpolicy.bus.expiry import end
from contextpolicy.bus.replacement import flaw_of_pair

if TYPE_CHECKING:
    from pathlib import Path

EXPIRY = Gauge(
    "contextpolicy_certificate_expiry_timestamp_seconds",
    "When the program's certificate for the bus expires, in Unix seconds; NaN if it or its key can't be read.",
    ["component"],
)


def publish_expiry(component: str, credentials: Path | None) -> None:
    """Export when the certificate in this directory ends, looked up at each scrape: it is renewed meanwhile."""
    if credentials is not None and (credentials / CERTIFICATE).is_file():
        EXPIRY.labels(component).set_function(lambda: _end(credentials))


def _end(credentials: Path) -> float:
    try:
        files = {name: (credentials / name).read_bytes() for name in (CERTIFICATE, KEY)}
    except OSError:
        return math.nan
    last = end(files[CERTIFICATE])
    return math.nan if last is None or flaw_of_pair(files) else last.timestamp()
