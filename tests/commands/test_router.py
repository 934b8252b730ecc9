"""The router as a program: it takes up a certificate that was replaced, and nobody has to restart anything."""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import threading
import urllib.request
from pathlib import Path
from queue import Queue

import pytest

from contextpolicy import cli
from contextpolicy.bus.router_supervisor import IN_VAIN
from contextpolicy.bus.session import open_router
from contextpolicy.commands import router
from contextpolicy.commands.bus_arguments import directory
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
            samples=[],
            metrics_port=None,
            uplink=[],
            max_message_bytes=1 << 20,
            fleet=fleet,
            supervised=False,
            ready_fd=None,
        )
        threads.append(threading.Thread(target=router.main, args=[arguments]))
        threads[0].start()

    yield start
    stop.set()
    threads[0].join(PATIENCE)
    assert not threads[0].is_alive()


def test_renewed_certificate_is_loaded_and_clients_reconnect(tmp_path, program, capfd):
    authority, endpoint = Authority(tmp_path), f"tls/127.0.0.1:{free_port()}"
    program(endpoint, authority.issue("router"))
    operator, agent = (client_of(endpoint, authority.issue(role)) for role in ("operator", "agent"))
    heard: Queue[str] = Queue()
    reported: list[str] = []

    def routed_again():
        reported.append(capfd.readouterr().out)
        return "".join(reported).count("routing at") == 2

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


def test_invalid_certificate_is_reported_and_the_former_kept(tmp_path, program, capfd):
    authority, endpoint = Authority(tmp_path), f"tls/127.0.0.1:{free_port()}"
    program(endpoint, authority.issue("router"))
    said: list[str] = []

    def reported(text):
        said.append("".join(capfd.readouterr()))
        return text in "".join(said)

    with client_of(endpoint, authority.issue("operator")) as operator, operator.declare_publisher(PLAN) as publisher:
        (tmp_path / "router" / "..data" / "tls.crt").write_text("garbage")
        until(lambda: reported("router/tls.crt: contains no PEM certificate; still using the previous files"))
        with client_of(endpoint, authority.issue("agent")) as agent:
            heard: Queue[str] = Queue()
            agent.declare_subscriber(PLAN, lambda sample: heard.put(sample.payload.to_string()))
            Matching(publisher).wait(expected=True)
            publisher.put("plan")
            assert heard.get(timeout=PATIENCE) == "plan"
        assert "".join(said).count("routing at") == 1
        authority.issue("router")
        until(lambda: reported("") and "".join(said).count("routing at") == 2)


def test_fleet_router_accepts_robots_and_viewers(tmp_path, program):
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
def test_fleet_and_uplink_require_certificates(place, files, tmp_path, capsys):
    for name in files or ():
        (tmp_path / name).write_text("")
    credentials = [] if files is None else ["--credentials", str(tmp_path)]
    assert cli.main(["router", *place, *credentials]) == 2
    assert "--uplink and --fleet need --credentials with ca.crt, tls.crt and tls.key" in capsys.readouterr().err


def test_credentials_directory_must_exist(tmp_path):
    assert directory(str(tmp_path)) == tmp_path
    with pytest.raises(argparse.ArgumentTypeError, match="'/no/such': expected an existing directory"):
        directory("/no/such")


@pytest.mark.parametrize("address", ["127.0.0.1", "[::1]"])
def test_it_listens_on_all_addresses_of_both_families(address, program):
    port = free_port()
    program(f"tcp/*:{port}", None)
    with client_of(f"tcp/{address}:{port}") as session:
        until(lambda: [*session.info.routers_zid()])


@pytest.mark.parametrize(("everywhere", "listened"), [("::", "tls/[::]:7447"), ("10.0.0.1", "tls/10.0.0.1:7447")])
def test_without_ipv6_in_the_kernel_it_listens_on_ipv4(everywhere, listened, monkeypatch):
    monkeypatch.setattr(router, "EVERYWHERE", everywhere)
    assert router.endpoints("tls/*:7447,tcp/127.0.0.1:7448") == [listened, "tcp/127.0.0.1:7448"]


@pytest.mark.parametrize(
    "keys", ["**", "robot/**,*/imu", "contextpolicy/robot/x", "context$*/**", "robot//imu", "/robot"]
)
def test_keys_for_samples_that_cover_ours_are_refused(keys, capsys):
    with pytest.raises(SystemExit):
        cli.main(["router", f"--samples={keys}"])
    assert ": invalid value " in capsys.readouterr().err


def routing(supervisor):
    """The process that routes; none while it is started again."""
    children = Path(f"/proc/{supervisor.pid}/task/{supervisor.pid}/children").read_text().split()
    return int(children[0]) if children else None


def test_killed_router_is_restarted_and_counted():
    """As soon as a client is back, and more often in a row than one that never routes would be started."""
    kills = IN_VAIN + 2
    port, metrics = free_port(), free_port()
    command = [sys.executable, "-m", "contextpolicy", "router", "--supervised"]
    command += [f"--listen=tcp/127.0.0.1:{port}", f"--metrics-port={metrics}"]
    supervisor = subprocess.Popen(command)
    try:
        with client_of(f"tcp/127.0.0.1:{port}") as session:
            for _ in range(kills):
                router_before = [*session.info.routers_zid()]
                process = routing(supervisor)
                assert process is not None
                os.kill(process, signal.SIGKILL)
                until(lambda old=router_before: (new := [*session.info.routers_zid()]) and new != old)
        page = urllib.request.urlopen(f"http://127.0.0.1:{metrics}/metrics", timeout=PATIENCE).read().decode()
        assert f"contextpolicy_router_restarts_total {kills}.0" in page
        last = routing(supervisor)
        supervisor.terminate()
        assert supervisor.wait(PATIENCE) == 0
        assert not Path(f"/proc/{last}").exists()
    finally:
        supervisor.kill()


def test_supervisor_does_not_retry_invalid_options(capfd):
    assert (
        subprocess.run(
            [sys.executable, "-m", "contextpolicy", "router", "--supervised", "--fleet"], timeout=PATIENCE, check=False
        ).returncode
        == 2
    )
    assert capfd.readouterr().err.count("--uplink and --fleet need --credentials") == 1
