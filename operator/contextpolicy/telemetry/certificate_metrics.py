"""The expiry of a program's certificate for the bus, as a metric."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from prometheus_client import Gauge

from contextpolicy.bus.credentials import CA, CERTIFICATE, KEY
from contextpolicy.bus.expiry import end_of_use
from contextpolicy.bus.replacement import flaw_of_pair

if TYPE_CHECKING:
    from pathlib import Path

EXPIRY = Gauge(
    "contextpolicy_certificate_expiry_timestamp_seconds",
    "When the program's certificate for the bus or all it trusts expires, in Unix seconds; NaN if these can't be read.",
    ["component"],
)


def publish_expiry(component: str, credentials: Path | None) -> None:
    """Export when the certificate in this directory ends, looked up at each scrape: it is renewed meanwhile."""
    if credentials is not None and (credentials / CERTIFICATE).is_file():
        EXPIRY.labels(component).set_function(lambda: _end(credentials))


def _end(credentials: Path) -> float:
    try:
        named = [CERTIFICATE, KEY, *([CA] if (credentials / CA).is_file() else [])]
        files = {name: (credentials / name).read_bytes() for name in named}
    except OSError:
        return math.nan
    last = end_of_use(files)
    return math.nan if last is None or flaw_of_pair(files) else last.timestamp()
