"""A sender that floods a stream: the operator's memory stays in bounds, and other streams still decide in time."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from contextpolicy.bus.session import open_visitor
from tests.e2e.cluster import apply, run, until
from tests.e2e.conftest import SYSTEM, router
from tests.e2e.metrics_page import address
from tests.e2e.robot import pod
from timelines.demo.cgroup import find

LIMIT = 384 << 20
"""The operator's memory limit in the chart."""
DELAY = 2.0
"""Seconds within which a change of context is in force while a stream is flooded."""
SENDER = """
import itertools, json, sys, time, zenoh
endpoint, key, size, rate, encoding, keys = sys.argv[1:]
size, rate, keys = int(size), float(rate), int(keys)
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([endpoint]))
config.insert_json5("scouting/multicast/enabled", "false")
many = max(1, size // 4)
payloads = {
    "json": b'{"n": 1, "fill": "' + b"x" * (size - 20) + b'"}',
    "json-values": b"[" + b"1.5," * (many - 1) + b"1.5]",
    "cbor": b"\\x9a" + (size - 5).to_bytes(4, "big") + b"\\xa0" * (size - 5),
    "msgpack": b"\\xdd" + (size - 5).to_bytes(4, "big") + b"\\x80" * (size - 5),
    "cdr": b"\\0\\1\\0\\0" + (size - 9).to_bytes(4, "little") + b"x" * (size - 9) + b"\\0",
}
payload, begun = payloads[encoding], time.monotonic()
with zenoh.open(config) as session:
    for number in itertools.count():
        session.put(f"{key}/{number % keys}", payload)
        time.sleep(max(0, begun + number / rate - time.monotonic()))
"""
FLOODS = {
    "json of 1.04 MB, 300 a second": ("json", 1_040_000, 300, 1),
    "json with too many values": ("json-values", 1_040_000, 300, 1),
    "cbor with too many values": ("cbor", 1_040_000, 300, 1),
    "msgpack with too many values": ("msgpack", 1_040_000, 300, 1),
    "cdr": ("cdr", 1_040_000, 300, 1),
    "beyond 1 MiB": ("json", 4_000_000, 100, 1),
    "many keys": ("json", 1000, 3000, 100_000),
    "10 kHz": ("json", 60, 10_000, 1),
}


@contextmanager
def flood(key, encoding, size, rate, keys):
    arguments = [router(), key, str(size), str(rate), encoding, str(keys)]
    sender = subprocess.Popen([sys.executable, "-c", SENDER, *arguments])
    try:
        yield sender
    finally:
        sender.kill()
        sender.wait()


def status_of(component):
    labels = f"app.kubernetes.io/component={component}"
    [pod] = json.loads(run("kubectl", "get", "pods", "-n", SYSTEM, "-l", labels, "-o", "json"))["items"]
    return pod["status"]["containerStatuses"][0]


def resident(cgroup):
    """Bytes of memory that the operator's processes hold."""
    pages = (Path(f"/proc/{pid}/statm").read_text(encoding="utf-8").split()[1] for pid in cgroup.processes())
    return sum(map(int, pages)) * 4096


@pytest.mark.parametrize("name", FLOODS)
def test_a_flood_takes_bounded_memory_and_delays_no_plan(governed, name):
    encoding, size, rate, keys = FLOODS[name]
    kind = encoding.partition("-")[0]
    typed = {"type": "std_msgs/msg/String"} if kind == "cdr" else {}
    loud = {"name": "loud", "key": f"{governed.namespace}/loud/*", "encoding": kind, **typed}
    imu = {"name": "imu", "key": f"{governed.namespace}/imu", "staleAfter": "5s"}
    governed.policy(streams=[imu, loud])
    governed.expect(slam=500, speech=500)
    before, router_before = status_of("operator"), status_of("router")
    cgroup = find(before["containerID"])
    assert cgroup is not None
    peak, slowest = 0, 0.0
    with flood(f"{governed.namespace}/loud", encoding, size, rate, keys) as sender:
        time.sleep(2)
        for speed, expected in ((0.3, {"slam": 990, "speech": 10}), (0.0, {"slam": 500, "speech": 500})) * 3:
            changed = time.monotonic()
            governed.drive(speed)
            peak = max(peak, resident(cgroup))
            while governed.limits("slam", "speech") != expected:
                peak = max(peak, resident(cgroup))
                assert time.monotonic() - changed < 10 * DELAY, f"{name}: no plan"
                time.sleep(0.01)
            slowest = max(slowest, time.monotonic() - changed)
        assert sender.poll() is None, "the flood went on"
    sys.stdout.write(f"\n{name}: {peak / 2**20:.0f} MiB, slowest change {slowest:.2f} s\n")
    assert status_of("operator")["restartCount"] == before["restartCount"]
    assert status_of("router")["containerID"] == router_before["containerID"]
    assert peak < LIMIT * 2 / 3
    assert slowest < DELAY
    until("the policy is ready again", lambda: governed.condition("Ready")[0] == "True" or governed.condition("Ready"))


HEADERS = """
import socket, sys, time
line = b"X: " + b"a" * 65_000 + b"\\r\\n"
held, end = [], time.monotonic() + 20
while time.monotonic() < end:
    try:
        client = socket.create_connection((sys.argv[1], int(sys.argv[2])), timeout=3)
        held = [*held[-500:], client]
        client.sendall(b"GET /healthz HTTP/1.1\\r\\n" + 95 * line)
    except OSError:
        pass
"""


@pytest.mark.parametrize(("component", "port", "limit"), [("operator", 8080, LIMIT), ("router", 8081, 256 << 20)])
def test_requests_without_end_take_bounded_memory_and_fail_no_probe(governed, component, port, limit):
    """From a pod without any certificate."""
    governed.policy(streams=[{"name": "imu", "key": f"{governed.namespace}/imu", "staleAfter": "5s"}])
    apply(pod("stranger", governed.namespace, ["python3", "-c", HEADERS, address(component), str(port)], None))
    until("it floods", lambda: run("kubectl", "get", "pod", "stranger", "-n", governed.namespace).find("Running") > 0)
    before = status_of(component)
    cgroup = find(before["containerID"])
    peak, end = 0, time.monotonic() + 20
    while time.monotonic() < end:
        peak = max(peak, resident(cgroup))
        assert status_of(component)["ready"]
        time.sleep(0.2)
    sys.stdout.write(f"\nrequests without end to {component}: {peak / 2**20:.0f} MiB\n")
    assert status_of(component)["containerID"] == before["containerID"]
    assert peak < limit * 2 / 3
    run("kubectl", "delete", "pod", "stranger", "-n", governed.namespace, "--now")


def test_cbor_references_that_expand_are_refused(governed):
    """It fits into a message, and would take 900 MB where something copies the value."""
    loud = {"name": "loud", "key": f"{governed.namespace}/loud", "encoding": "cbor"}
    imu = {"name": "imu", "key": f"{governed.namespace}/imu", "staleAfter": "5s"}
    governed.policy(streams=[imu, loud])
    governed.expect(slam=500, speech=500)
    before = status_of("operator")
    text = b"\xd8\x1c\x7a" + (900_000).to_bytes(4, "big") + b"x" * 900_000
    with open_visitor([router()], patience=20) as sender:
        sender.put(f"{governed.namespace}/loud", b"\xa1\x64mode\x99\x03\xe9" + text + b"\xd8\x1d\x00" * 1000)
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    assert status_of("operator")["containerID"] == before["containerID"]
