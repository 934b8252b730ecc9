"""Whether the files of a listener can take the place of those that it works with. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509 import load_pem_x509_certificates

from contextpolicy.bus.credentials import CA, CERTIFICATE, KEY
from contextpolicy.bus.issuing import UNREADABLE

if TYPE_CHECKING:
    from collections.abc import Mapping
    from datetime import datetime

    from cryptography.x509 import Certificate

    Files = Mapping[str, bytes]


def flaw(files: Files, former: Files, now: datetime) -> str:
    """Why a listener can't work with these files instead of the former ones; empty when it can.

    A certificate that has ended is better than one that has ended before it.
    """
    if CERTIFICATE not in files and CERTIFICATE not in former:
        return ""
    if (CA in files or CA in former) and _first(files, CA) is None:
        return f"{CA}: contains no PEM certificate"
    return flaw_of_pair(files) or _lateness(_first(files, CERTIFICATE), _first(former, CERTIFICATE), now)


def flaw_of_pair(files: Files) -> str:
    """Why `tls.crt` and `tls.key` are no certificate with its key; empty when they are."""
    certificate = _first(files, CERTIFICATE)
    if certificate is None:
        return f"{CERTIFICATE}: contains no PEM certificate"
    try:
        key = load_pem_private_key(files[KEY], None)
    except UNREADABLE:
        return f"{KEY}: contains no PEM private key"
    return "" if key.public_key() == certificate.public_key() else f"{KEY}: does not match {CERTIFICATE}"


def _lateness(certificate: Certificate | None, former: Certificate | None, now: datetime) -> str:
    last = certificate.not_valid_after_utc if certificate else now
    if last <= now and (former is None or last <= former.not_valid_after_utc):
        return f"{CERTIFICATE}: expired at {last.isoformat()}"
    return ""


def _first(files: Files, name: str) -> Certificate | None:
    try:
        return load_pem_x509_certificates(files[name])[0]
    except UNREADABLE:
        return None
