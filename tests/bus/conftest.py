"""An authority, and a router's passwords."""

from __future__ import annotations

import pytest

from tests.bus.certificates import ROLES, Authority


@pytest.fixture(scope="module")
def authority(tmp_path_factory):
    return Authority(tmp_path_factory.mktemp("authority"))


@pytest.fixture(scope="module")
def users(authority):
    """A router that asks for passwords."""
    directory = authority.issue("router", name="router-with-users")
    (directory / "users.txt").write_text("".join(f"{role}:secret-of-{role}\n" for role in ROLES))
    return directory
