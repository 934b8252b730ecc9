"""Ways to be let in by a router, or not."""

from __future__ import annotations

import pytest
import zenoh
import zenoh.ext

from contextpolicy.bus.session import open_visitor

ATTEMPT = 0.7


def with_password(authority, role, password=""):
    directory = authority.trust(f"{role}-with-{password or 'password'}")
    (directory / "username").write_text(role)
    (directory / "password").write_text(password or f"secret-of-{role}\n")
    return directory


def refused(endpoint, credentials):
    with pytest.raises(zenoh.ZError):
        open_visitor([endpoint], patience=ATTEMPT, credentials=credentials)
