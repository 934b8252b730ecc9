"""A robot without a clock battery: router and clients start in 1970, and when the clock is set nothing is lost."""

from __future__ import annotations

import subprocess
import sys
import time
from datetime import UTC, datetime, timedelta

import pytest

from contextpolicy.bus.issuing import LIFETIME, found_authority, pem
from contextpolicy.bus.renewal import Release, due
from tests import fake_clock
from tests.bus.test_renewal import directory
from tests.ports import free_port
from tests.waiting import PATIENCE

ATTEMPT = 1.0
"""Seconds until a client gives up that is not let in; who is let in is so within a few hundredths."""

TALK = """
import sys, time
from pathlib import Path
from contextpolicy.bus.session import open_router, open_visitor
endpoint, router, operator, patience = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]), float(sys.argv[4])
print(int(time.time()))
with open_router([endpoint], router), open_visitor([endpoint], patience=patience, credentials=operator) as session:
    print("routers", len(list(session.info.routers_zid())))
"""


@pytest.fixture(scope="module")
def clock(tmp_path_factory):
    return fake_clock.build(tmp_path_factory.mktemp("clock"))


@pytest.fixture(scope="module")
def secrets(tmp_path_factory):
    """What the Job makes now, as pods mount it."""
    folder = tmp_path_factory.mktemp("secrets")
    release = Release("system", "ctxp", names=["127.0.0.1"])
    made = due(release, {}, datetime.now(UTC))
    return {
        role: directory(made[place], folder / role)
        for place, role in release.roles().items()
        if role in ("router", "operator")
    }


def talk(clock, secrets, when, patience=PATIENCE):
    """What a router and a client say to each other, if they do, whose clock starts at this time."""
    endpoint = f"tls/127.0.0.1:{free_port()}"
    return subprocess.run(
        [sys.executable, "-c", TALK, endpoint, secrets["router"], secrets["operator"], str(patience)],
        env=fake_clock.environment(clock, when - time.time()),
        capture_output=True,
        text=True,
        timeout=2 * PATIENCE,
        check=False,
    )


@pytest.mark.parametrize("when", [10.0, datetime(2000, 1, 1, tzinfo=UTC).timestamp()], ids=["1970", "2000"])
def test_bus_works_with_an_unset_clock(clock, secrets, when):
    done = talk(clock, secrets, when)
    seen, said = done.stdout.splitlines() or ("0", done.stderr)
    assert abs(int(seen) - when) < PATIENCE, "the clock is another one, or this test proves nothing"
    assert said == "routers 1", done.stderr


def test_certificate_valid_only_from_today_fails_with_an_unset_clock(clock, tmp_path, monkeypatch):
    now = datetime.now(UTC)
    monkeypatch.setattr("contextpolicy.bus.issuing.BEGIN", now - timedelta(days=1))
    authority = found_authority("ctxp", now)
    files = {"ca.crt": pem([authority.certificate])}
    young = {
        role: directory(files | authority.issue(role, ["127.0.0.1"], now), tmp_path / role)
        for role in ("router", "operator")
    }
    assert "routers 1" in talk(clock, young, time.time()).stdout
    assert "routers 1" not in talk(clock, young, 10.0, ATTEMPT).stdout


def test_expired_certificate_is_refused(clock, secrets):
    late = (datetime.now(UTC) + LIFETIME + timedelta(days=1)).timestamp()
    assert "routers 1" not in talk(clock, secrets, late, ATTEMPT).stdout
