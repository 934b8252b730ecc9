"""Every server answers IPv4 and IPv6, and in a network that has only one of them that one."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.waiting import PATIENCE

SERVE = """
import sys, urllib.request
from contextpolicy.agent.service import serve as serve_agent
from contextpolicy.app.probes import serve as serve_probes
from contextpolicy.bus.session import open_router, open_visitor
from contextpolicy.commands.router import endpoints
from contextpolicy.live.page_server import PageServer
from contextpolicy.telemetry.metrics_server import serve_metrics

class Watched:
    def boards(self):
        return []

page = PageServer(0, Watched())
page.start()
ports = {
    "healthz": serve_probes(0, {"/healthz": list}).server_port,
    "healthz?agent": serve_agent(0, lambda: True),
    "metrics": serve_metrics(0),
}
for host in sys.argv[1:]:
    for path, port in ports.items():
        print(host, path, urllib.request.urlopen(f"http://{host}:{port}/{path}", timeout=5).status)
    with open_router(endpoints("tcp/*:7447")), open_visitor([f"tcp/{host}:7447"], patience=5) as session:
        print(host, "router", len(list(session.info.routers_zid())))
own = sys.argv[-1]
print(own, "page", urllib.request.urlopen(f"http://{own}:{page.server_port}/api/boards", timeout=5).status)
"""
ONLY_6 = "ip -4 address flush dev lo"
ONLY_4 = "ip -6 address flush dev lo"


def answers(setup, *hosts):
    """What is answered in a network of its own; the live page is asked at the last host."""
    command = f'ip link set lo up && {setup} && exec "$0" -c "$1" {" ".join(hosts)}'
    done = subprocess.run(
        ["unshare", "--map-root-user", "--net", "sh", "-c", command, sys.executable, SERVE],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.parametrize(
    ("setup", "hosts"),
    [(ONLY_6, ("[::1]",)), (ONLY_4, ("127.0.0.1",)), ("true", ("[::1]", "127.0.0.1"))],
    ids=["IPv6 only", "IPv4 only", "dual stack"],
)
def test_all_servers_answer(setup, hosts):
    expected = [
        f"{host} {what}" for host in hosts for what in ("healthz 200", "healthz?agent 200", "metrics 200", "router 1")
    ]
    assert answers(setup, *hosts) == [*expected, f"{hosts[-1]} page 200"]


def test_ipv4_is_unreachable_without_ipv4():
    """Else the test above proves nothing."""
    with pytest.raises(AssertionError):
        answers(ONLY_6, "127.0.0.1")
