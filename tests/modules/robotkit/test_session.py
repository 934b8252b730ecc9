from __future__ import annotations

import json
import threading
from types import SimpleNamespace

import pytest
import zenoh

from contextpolicy.bus.session import open_router
from robotkit import ConfigurationError
from robotkit.session import client_config, credentials, endpoints, open_session
from tests.bus.certificates import Authority
from tests.modules.robotkit.bus import router, soon
from tests.ports import free_port
from tests.waiting import PATIENCE


def test_addresses_come_from_the_environment():
    assert endpoints({"ZENOH_CONNECT": "tcp/a:1, tcp/b:2,"}) == ("tcp/a:1", "tcp/b:2")


@pytest.mark.parametrize("environment", [{}, {"ZENOH_CONNECT": " , "}])
def test_an_empty_address_says_what_to_set(environment):
    with pytest.raises(ConfigurationError, match="ZENOH_CONNECT"):
        endpoints(environment)


def test_an_invalid_address_is_refused():
    with pytest.raises(ConfigurationError, match="nonsense"):
        client_config(["nonsense"])


def test_a_session_waits_for_its_router():
    port = free_port()
    connected = threading.Event()

    def connect():
        with open_session([f"tcp/127.0.0.1:{port}"], threading.Event()) as session:
            connected.set()
            assert session is not None
            return list(session.info.routers_zid())

    thread_done = []
    thread = threading.Thread(target=lambda: thread_done.append(connect()))
    thread.start()
    with router(port):
        assert connected.wait(PATIENCE)
        thread.join(PATIENCE)
    assert len(thread_done[0]) == 1


def test_a_certificate_may_come_after_the_module(monkeypatch, tmp_path):
    """Its Secret is mounted empty until the Job has written it."""
    seen = []

    def late(config):
        seen.append(config.get_json("transport/link/tls/root_ca_certificate"))
        if len(seen) == 1:
            (tmp_path / "ca.crt").write_text("")
            raise zenoh.ZError
        return SimpleNamespace(close=lambda: None)

    monkeypatch.setattr(zenoh, "open", late)
    monkeypatch.setattr("robotkit.session.PAUSE_S", 0)
    with open_session(["tls/127.0.0.1:1"], threading.Event(), secret=tmp_path):
        assert seen == ["null", json.dumps(str(tmp_path / "ca.crt"))]


def test_a_slow_handshake_gets_more_time_with_each_attempt(monkeypatch):
    """All attempts took a second: one that needs longer for TLS, on its hundredth of a core, might never connect."""
    given = []

    def slow(config):
        given.append(int(config.get_json("connect/timeout_ms")))
        if len(given) < 6:
            raise zenoh.ZError
        return SimpleNamespace(close=lambda: None)

    monkeypatch.setattr(zenoh, "open", slow)
    monkeypatch.setattr("robotkit.session.PAUSE_S", 0)
    with open_session(["tls/127.0.0.1:7447"], threading.Event()):
        assert given == [1000, 2000, 4000, 4000, 4000, 4000]


def test_stop_ends_the_wait_for_a_router():
    stop = threading.Event()
    stop.set()

    def connect():
        with open_session(["tcp/127.0.0.1:1"], stop) as session:
            return session

    assert soon(connect) is None


def test_a_module_authenticates_with_its_certificate(tmp_path):
    authority, address = Authority(tmp_path), f"tls/127.0.0.1:{free_port()}"
    secret = credentials({"ZENOH_CREDENTIALS": str(authority.issue("module"))})
    stop = threading.Event()
    with open_router([address], authority.issue("router")), open_session([address], stop, secret=secret) as session:
        assert session is not None
        assert list(session.info.routers_zid())


def test_a_module_has_its_password_from_a_file(tmp_path):
    for name, text in (("ca.crt", "ca"), ("username", "module"), ("password", "s3cret\n")):
        (tmp_path / name).write_text(text)
    config = client_config(["tls/127.0.0.1:1"], secret=tmp_path)
    assert config.get_json("transport/auth/usrpwd/user") == '"module"'
    assert config.get_json("transport/link/tls/enable_mtls") in ("null", "false")


def test_credentials_are_optional_but_must_exist():
    assert credentials({}) is None
    with pytest.raises(ConfigurationError, match="ZENOH_CREDENTIALS"):
        credentials({"ZENOH_CREDENTIALS": "/no/such/secret"})
