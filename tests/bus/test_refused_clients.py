"""Who is not let in at all, and who no longer."""

from __future__ import annotations

import json
from contextlib import suppress
from threading import Event

import pytest
import zenoh
import zenoh.ext

from contextpolicy.bus.session import open_client, open_router, open_visitor
from tests.bus.certificates import Authority
from tests.bus.entering import refused, with_password
from tests.bus.hearing import Heard
from tests.ports import free_port
from tests.waiting import PATIENCE, until

SAMPLE = "robot/imu"


@pytest.fixture(scope="module")
def closed(authority):
    endpoint = f"tls/127.0.0.1:{free_port()}"
    with open_router([endpoint], authority.issue("router", name="closed")):
        yield endpoint


def test_clients_without_a_certificate_are_refused(authority, closed):
    refused(closed, authority.trust("anonymous"))
    refused(closed.replace("tls/", "tcp/"), None)


def test_password_does_not_replace_a_certificate(authority, closed):
    refused(closed, with_password(authority, "operator"))


def test_an_expired_certificate_is_not_let_in(authority, closed):
    refused(closed, authority.issue("operator", name="expired", seconds=-1))


def test_a_certificate_of_another_authority_is_not_let_in(authority, closed, tmp_path):
    foreign = Authority(tmp_path).issue("operator")
    (foreign / "ca.crt").write_bytes((authority.trust("anonymous") / "ca.crt").read_bytes())
    refused(closed, foreign)


def test_client_refuses_a_router_of_another_authority(closed, tmp_path):
    refused(closed, Authority(tmp_path).issue("operator"))


@pytest.mark.parametrize("password", ["wrong", None], ids=["wrong", "none"])
def test_clients_without_the_password_are_refused(authority, users, password):
    endpoint = f"tls/127.0.0.1:{free_port()}"
    stranger = with_password(authority, "operator", password) if password else authority.trust("anonymous")
    with open_router([endpoint], users):
        refused(endpoint, stranger)


def test_unknown_role_may_connect_but_do_nothing(authority, closed):
    stranger = authority.issue("admin")
    with (
        open_visitor([closed], patience=PATIENCE, credentials=stranger) as session,
        open_visitor([closed], patience=PATIENCE, credentials=stranger) as listener,
        open_visitor([closed], patience=PATIENCE, credentials=authority.issue("operator")) as operator,
        Heard(listener, "**") as overheard,
        Heard(operator, SAMPLE) as heard,
        open_visitor([closed], patience=PATIENCE, credentials=authority.issue("sensor")) as sensor,
    ):
        session.put(SAMPLE, "forged")
        heard.until(sensor, SAMPLE, "sample")
        heard.nothing()
        overheard.nothing()


def routers(session):
    return list(session.info.routers_zid())


def test_session_ends_when_its_certificate_expires_until_renewal(authority, closed):
    """Nothing is restarted: Zenoh reads a client's files each time it connects."""
    sessions = []

    def opened():
        credentials = authority.issue("operator", name="short", seconds=3)
        with suppress(zenoh.ZError):  # it took so long that the certificate has ended before
            sessions.append(open_visitor([closed], patience=PATIENCE, credentials=credentials))
        return sessions

    until(opened)
    with sessions[0] as session:
        until(lambda: not routers(session))
        authority.issue("operator", name="short")
        until(lambda: routers(session))


def test_no_secret_is_reported(authority, closed, capfd, caplog):
    secret = with_password(authority, "operator", "do-not-tell")
    refused(closed, secret)
    stop = Event()
    open_client([closed.replace("tls/", "nonsense/")], _after_one(stop), secret)
    key = (authority.issue("operator") / "tls.key").read_text().splitlines()[1]
    said = json.dumps([record.getMessage() for record in caplog.records]) + "".join(capfd.readouterr())
    assert "do-not-tell" not in said
    assert key not in said
    assert caplog.records


def _after_one(stop):
    """Stops the attempts after the first."""
    stop.wait = lambda _: stop.set()
    return stop
