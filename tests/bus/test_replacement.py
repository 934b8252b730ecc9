"""Which files may replace those that a router listens with."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import pytest

from contextpolicy.bus.issuing import LIFETIME, found_authority, pem
from contextpolicy.bus.replacement import flaw

NOW = datetime(2026, 11, 24, tzinfo=UTC)
DAY = timedelta(days=1)
ISSUER = found_authority("bus", NOW)


def files(now=NOW):
    return {"ca.crt": pem([ISSUER.certificate]), **ISSUER.issue("router", ["localhost"], now)}


def test_renewed_certificate_is_accepted():
    assert flaw(files(NOW + DAY), files(), NOW) == ""


@pytest.mark.parametrize("name", ["tls.crt", "tls.key", "ca.crt"])
@pytest.mark.parametrize("content", [None, b"", b"garbage", b"-----BEGIN nonsense", b"\xff\xfe"])
def test_missing_or_invalid_files_are_rejected(name, content):
    broken = files() | ({} if content is None else {name: content})
    if content is None:
        del broken[name]
    assert flaw(broken, files(), NOW).startswith(f"{name}: contains no PEM ")


def test_mismatched_key_is_rejected():
    assert flaw(files() | {"tls.key": files()["tls.key"]}, files(), NOW) == "tls.key: does not match tls.crt"


def test_expired_certificate_is_accepted_only_if_it_ends_later():
    ended = files(NOW - LIFETIME)
    assert flaw(ended, files(), NOW) == "tls.crt: expired at 2026-11-24T00:00:00+00:00"
    assert flaw(ended, files(NOW - LIFETIME - DAY), NOW) == ""


def test_passwords_without_a_certificate_are_accepted():
    assert flaw({"users.txt": b"a:c"}, {"users.txt": b"a:b"}, NOW) == ""
