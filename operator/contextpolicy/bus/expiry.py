"""When certificates end. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cryptography.x509 import InvalidVersion, load_pem_x509_certificates

from contextpolicy.bus.credentials import CA, CERTIFICATE

if TYPE_CHECKING:
    from collections.abc import Mapping
    from datetime import datetime


def end(pem: bytes) -> datetime | None:
    """The first end of the certificates in a file; None when it has none that can be read."""
    return min(_ends(pem), default=None)


def end_of_use(files: Mapping[str, bytes]) -> datetime | None:
    """When a component can no longer connect; None when that can't be read.

    That is when its own certificate expires, or the last of the authorities that it trusts.
    """
    own, last = end(files.get(CERTIFICATE, b"")), max(_ends(files.get(CA, b"")), default=None)
    if CA not in files:
        return own
    return None if own is None or last is None else min(own, last)


def _ends(pem: bytes) -> list[datetime]:
    try:
        return [one.not_valid_after_utc for one in load_pem_x509_certificates(pem)]
    except (ValueError, InvalidVersion):
        return []
