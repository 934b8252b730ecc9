"""When certificates end. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cryptography.x509 import InvalidVersion, load_pem_x509_certificates

if TYPE_CHECKING:
    from datetime import datetime


def end(pem: bytes) -> datetime | None:
    """The first end of the certificates in a file; None when it has none that can be read."""
    try:
        return min(one.not_valid_after_utc for one in load_pem_x509_certificates(pem))
    except (ValueError, InvalidVersion):
        return None
