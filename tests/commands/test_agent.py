"""The agent as a program: from signal to exit code, with what it leaves behind."""

from __future__ import annotations

import itertools
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from urllib.request import urlopen

import pytest

from contextpolicy.agent.state_directory import StateDirectory
from contextpolicy.bus.decision_bus import plan_key
from contextpolicy.bus.session import open_router
from contextpolicy.bus.signatures import Signer
from tests.agent.builders import NODE, SLAM, SPEECH, Tree, a_message, a_target
from tests.bus.certificates import Authority, signing_keys
from tests.bus.client import client_of
from tests.modules.robotkit.bus import Matching, client, router
from tests.ports import free_port
from tests.waiting import PATIENCE, until

KEY = plan_key("robot", "delivery")
PROGRAM = ("-m", "contextpolicy")
IMPATIENT = (
    "-c",
    (
        "from contextpolicy import cli; from contextpolicy.commands import agent; agent.TURN = 0.1; "
        "raise SystemExit(cli.main())"
    ),
)
"""The program, but it does not wait long for its turn."""


@pytest.fixture
def address():
    with router() as address:
        yield address


@pytest.fixture
def session(address):
    with client(address) as session:
        yield session


@pytest.fixture
def keys(tmp_path):
    return signing_keys(tmp_path / "keys")


class Operator:
    """Publishes plans as soon as the agent listens."""

    def __init__(self, session, keys):
        self._publisher, self._signer = session.declare_publisher(KEY), Signer(keys)

    def wait(self):
        Matching(self._publisher).wait(expected=True)

    def publish(self, plan):
        self.wait()
        self._publisher.put(plan, attachment=self._signer.sign(KEY, plan, time.time_ns()))

    def forge(self, plan):
        self.wait()
        self._publisher.put(plan)


@pytest.fixture
def operator(session, keys):
    return Operator(session, keys)


@pytest.fixture
def tree(tmp_path):
    return Tree(tmp_path / "cgroup")


@pytest.fixture
def slam(tree):
    return tree.container(SLAM)


@pytest.fixture
def start(tmp_path, tree, address, keys, free_port):
    """Start the program with this node's settings, and `more`."""
    started = []

    def start(*arguments, program=PROGRAM, **more):
        environment = os.environ | {
            "NODE_NAME": NODE,
            "ZENOH_CONNECT": address,
            "CGROUP_ROOT": str(tree.mount),
            "POD_LOGS": str(tree.logs),
            "PLAN_SIGNING": str(keys),
            "METRICS_PORT": str(free_port),
            "STATE_DIRECTORY": str(tmp_path / "state"),
            "PYTHONPATH": "operator",
            **more,
        }
        command = [sys.executable, *program, "agent", *arguments]
        process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


@pytest.fixture(name="free_port")
def _free_port():
    return free_port()


def test_sigterm_undoes_the_plan(start, operator, tree, slam):
    process = start()
    operator.publish(a_message(a_target(SLAM, 0.9)))
    until(lambda: tree.limit(slam) == 900)
    process.send_signal(signal.SIGTERM)
    assert process.wait(PATIENCE) == 0
    assert tree.limit(slam) == 500


def test_plan_waits_until_the_journal_is_writable(start, operator, tree, slam, tmp_path):
    """Better no faster limit than one that nobody could undo."""
    process = start()
    operator.wait()
    shutil.rmtree(tmp_path / "state")
    (tmp_path / "state").touch()
    operator.publish(a_message(a_target(SLAM, 0.9)))
    assert any("Unsaved" in line for line in process.stderr)
    assert tree.limit(slam) == 500
    (tmp_path / "state").unlink()
    operator.publish(a_message(a_target(SLAM, 0.9)))
    until(lambda: tree.limit(slam) == 900)


def test_kill_frees_the_lock_and_leaves_the_journal(start, operator, tree, slam, tmp_path):
    process = start()
    operator.publish(a_message(a_target(SLAM, 0.9)))
    until(lambda: tree.limit(slam) == 900)
    state = StateDirectory(tmp_path / "state")
    assert not state.take_now()
    process.kill()
    process.wait(PATIENCE)
    assert state.take_now()
    assert state.anything_left


def test_agent_exits_if_the_lock_stays_held(start, tmp_path):
    state = StateDirectory(tmp_path / "state")
    assert state.take_now()
    process = start(program=IMPATIENT)
    _, said = process.communicate(timeout=PATIENCE)
    assert "agent.lock: another agent, or a supervisor that undoes, has held the lock for 0.1 s" in said
    assert process.returncode == 1


def test_settings_that_are_invalid_are_reported(start):
    process = start("--priority", "500")
    _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode == 2
    assert "argument --priority: invalid value '500': expected an integer from 1 to 99" in said


def test_liveness_and_state_are_reported(start, operator, slam, free_port):  # noqa: ARG001
    start()
    operator.forge(a_message(a_target(SLAM, 0.1)))
    operator.publish(a_message(a_target(SLAM, 0.9)))
    until(lambda: "contextpolicy_agent_plan_seconds_count 1.0" in read(free_port, "metrics"))
    assert 'contextpolicy_agent_refusals_total{reason="Unsigned"} 1.0' in read(free_port, "metrics")
    assert read(free_port, "healthz") == "ok\n"


class Captured:
    """Plans as the operator says them on a closed bus, and what it takes to say them again."""

    def __init__(self, session, keys):
        self._operator, self._signer = Operator(session, keys), Signer(keys)
        self.said = []

    def publish(self, plan):
        self._operator.wait()
        attachment = self._signer.sign(KEY, plan, time.time_ns())
        self._operator._publisher.put(plan, attachment=attachment)
        self.said.append((plan, attachment))

    def withdraw(self):
        """Returns the proof that goes with it."""
        attachment = self._signer.sign(KEY, None, time.time_ns())
        self._operator._publisher.delete(attachment=attachment)
        return attachment


@pytest.fixture
def closed(tmp_path, start, keys):
    """An agent on a closed bus, an operator, and somebody who has the operator's certificate but not its key."""
    authority, endpoint = Authority(tmp_path / "authority"), f"tls/127.0.0.1:{free_port()}"
    with open_router([endpoint], authority.issue("router")):
        start(ZENOH_CONNECT=endpoint, ZENOH_CREDENTIALS=str(authority.issue("agent")))
        own, stolen = authority.issue("operator"), authority.issue("operator", name="thief")
        with client_of(endpoint, own) as operator, client_of(endpoint, stolen) as thief:
            yield Captured(operator, keys), thief


def refused(port):
    """How many messages the agent has refused as said again."""
    found = re.search(r'refusals_total{reason="Repeated"} (\d+)', read(port, "metrics"))
    return int(found[1]) if found else 0


@pytest.mark.parametrize("which", [slice(None), slice(0, 1), slice(1, 2)], ids=["all", "the older", "the newest"])
def test_replayed_plan_is_refused_and_counted(closed, tree, slam, free_port, which):
    """All at once, so that the newest arrives before the agent's loop has looked at the older."""
    operator, thief = closed
    for sequence, limit in enumerate((900, 700), 1):
        operator.publish(a_message(a_target(SLAM, limit / 1000), sequence=sequence))
        until(lambda limit=limit: tree.limit(slam) == limit)
    for plan, attachment in operator.said[which]:
        thief.put(KEY, plan, attachment=attachment)
    until(lambda: refused(free_port) == len(operator.said[which]))
    assert tree.limit(slam) == 700


def test_replayed_withdrawal_does_not_undo_a_later_plan(closed, tree, slam, free_port):
    """The policy was deleted and created again: saying its withdrawal again is nobody's way to take its CPU."""
    operator, thief = closed
    operator.publish(a_message(a_target(SLAM, 0.9)))
    until(lambda: tree.limit(slam) == 900)
    withdrawn = operator.withdraw()
    until(lambda: tree.limit(slam) == 500)
    operator.publish(a_message(a_target(SLAM, 0.7), sequence=2))
    until(lambda: tree.limit(slam) == 700)
    thief.delete(KEY, attachment=withdrawn)
    until(lambda: refused(free_port) == 1)
    assert tree.limit(slam) == 700


def test_a_signed_plan_for_a_container_of_another_namespace_moves_nothing(closed, tree, slam, free_port):
    """Anyone who takes over the operator, its key included, decides for the policy's namespace and no other."""
    foreign = tree.container(SPEECH)
    tree.pod("uid-b", "kube-system")
    operator, _ = closed
    operator.publish(a_message(a_target(SLAM, 0.4), a_target(SPEECH, 0.01, task="speech")))
    until(lambda: tree.limit(slam) == 400)
    assert tree.limit(foreign) == 500
    assert 'refusals_total{reason="Foreign"} 1.0' in read(free_port, "metrics")


def test_key_rotation_under_load_loses_no_plan(  # noqa: PLR0913, PLR0917 - fixtures
    closed, tree, slam, keys, free_port, tmp_path
):
    """As the how-to says: first both certificates, then the new key, then its certificate alone."""
    operator, thief = closed
    former = Signer(copied(keys, tmp_path / "former"))
    shares, numbers = itertools.cycle((0.9, 0.7)), itertools.count(1)

    def storm():
        for number, share in itertools.islice(zip(numbers, shares, strict=True), 50):
            operator.publish(a_message(a_target(SLAM, share), sequence=number))
            if number % 5 == 0:  # a router drops what it can't pass on in time
                until(lambda share=share: tree.limit(slam) == share * 1000)

    storm()
    fresh = signing_keys(tmp_path / "fresh")
    both = (keys / "tls.crt").read_bytes() + (fresh / "tls.crt").read_bytes()
    replace(keys / "tls.crt", both)
    storm()
    replace(keys / "tls.key", (fresh / "tls.key").read_bytes())
    storm()
    replace(keys / "tls.crt", (fresh / "tls.crt").read_bytes())
    storm()
    assert 'refusals_total{reason="Forged"} 0.0' in read(free_port, "metrics")
    stale = a_message(a_target(SLAM, 0.7), sequence=next(numbers))

    def forged():
        thief.put(KEY, stale, attachment=former.sign(KEY, stale, time.time_ns()))
        return 'refusals_total{reason="Forged"} 0.0' not in read(free_port, "metrics")

    until(forged)
    assert tree.limit(slam) == 700


def copied(keys, directory):
    """The key as it is now; it stays when the other is replaced."""
    shutil.copytree(keys, directory)
    return directory


def replace(file, content):
    """A reader finds at any time the old file or the new one."""
    fresh = file.with_name(f".{file.name}")
    fresh.write_bytes(content)
    fresh.replace(file)


def read(port, page):
    with urlopen(f"http://127.0.0.1:{port}/{page}", timeout=PATIENCE) as answer:
        return answer.read().decode()
