"""The router as a program: it takes up a certificate that was replaced, and nobody has to restart anything."""

from __future__ import annotations

import argparse
import socket
import threading
from queue import Queue

import pytest

from contextpolicy import cli
from contextpolicy.bus.session import open_router
from contextpolicy.commands import router
from contextpolicy.commands.credentials import directory
from tests.bus.certificates import Authority
from tests.bus.client import client_of
from tests.modules.robotkit.bus import Matching
from tests.ports import free_port
from tests.waiting import PATIENCE, until

PLAN = "contextpolicy/robot/delivery/plan"


@pytest.fixture
def program(monkeypatch):
    """Run the command on a thread, where there are no signals."""
    stop, threads = threading.Event(), []
    monkeypatch.setattr(router, "stop_on_signals", lambda: stop)
    monkeypatch.setattr(router, "LOOK", 0.02)

    def start(endpoint, credentials, *, fleet=False):
        arguments = argparse.Namespace(
            listen=router.endpoints(endpoint),
            credentials=credentials,
            samples="**",
            metrics_port=None,
            uplink=[],
            fleet=fleet,
        )
        threads.append(threading.Thread(target=router.main, args=[arguments]))
        threads[0].start()

    yield start
    stop.set()
    threads[0].join(PATIENCE)
    assert not threads[0].is_alive()


def test_a_renewed_certificate_is_taken_up_and_clients_come_back(tmp_path, program, capfd):
    authority, endpoint = Authority(tmp_path), f"tls/127.0.0.1:{free_port()}"
    program(endpoint, authority.issue("router"))
    operator, agent = (client_of(endpoint, authority.issue(role)) for role in ("operator", "agent"))
    heard: Queue[str] = Queue()
    told: list[str] = []

    def routed_again():
        told.append(capfd.readouterr().out)
        return "".join(told).count("routing at") == 2

    with operator, agent, operator.declare_publisher(PLAN) as publisher:
        agent.declare_subscriber(PLAN, lambda sample: heard.put(sample.payload.to_string()))
        matching = Matching(publisher)
        matching.wait(expected=True)
        authority.issue("router")
        matching.wait(expected=False)
        matching.wait(expected=True)
        publisher.put("next plan")
        assert heard.get(timeout=PATIENCE) == "next plan"
    until(routed_again)  # clients may be back before the router has said so


def test_a_fleets_router_is_one_too(tmp_path, program):
    authority, endpoint = Authority(tmp_path), f"tls/127.0.0.1:{free_port()}"
    program(endpoint, authority.issue("viewer", name="fleet"), fleet=True)
    with (
        open_router([f"tls/127.0.0.1:{free_port()}"], authority.issue("router"), uplink=[endpoint]) as robot,
        client_of(endpoint, authority.issue("viewer")) as viewer,
    ):
        until(lambda: [*robot.info.routers_zid()])
        assert [*viewer.info.routers_zid()] == [*robot.info.routers_zid()]


@pytest.mark.parametrize("place", [["--fleet"], ["--uplink", "tls/fleet:7447"]])
@pytest.mark.parametrize("files", [None, (), ("tls.crt", "users.txt")])
def test_many_robots_take_certificates(place, files, tmp_path, capsys):
    for name in files or ():
        (tmp_path / name).write_text("")
    credentials = [] if files is None else ["--credentials", str(tmp_path)]
    assert cli.main(["router", *place, *credentials]) == 2
    assert "--uplink and --fleet need --credentials with ca.crt, tls.crt and tls.key" in capsys.readouterr().err


def test_credentials_must_be_there(tmp_path):
    assert directory(str(tmp_path)) == tmp_path
    with pytest.raises(argparse.ArgumentTypeError, match="/no/such is no directory"):
        directory("/no/such")


@pytest.mark.parametrize("address", ["127.0.0.1", "[::1]"])
def test_it_listens_on_all_addresses_of_both_families(address, program):
    port = free_port()
    program(f"tcp/*:{port}", None)
    with client_of(f"tcp/{address}:{port}") as session:
        until(lambda: [*session.info.routers_zid()])


@pytest.mark.parametrize(("dual", "listened"), [(True, "tls/[::]:7447"), (False, "tls/0.0.0.0:7447")])
def test_without_ipv6_in_the_kernel_it_listens_on_ipv4(dual, listened, monkeypatch):
    monkeypatch.setattr(socket, "has_dualstack_ipv6", lambda: dual)
    assert router.endpoints("tls/*:7447,tcp/127.0.0.1:7448") == [listened, "tcp/127.0.0.1:7448"]
