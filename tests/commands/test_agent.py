"""The agent as a program: from signal to exit code, with what it leaves behind."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from urllib.request import urlopen

import pytest

from contextpolicy.agent.state_directory import StateDirectory
from contextpolicy.bus.decision_bus import plan_key
from contextpolicy.bus.signatures import Signer
from tests.agent.builders import NODE, SLAM, Tree, a_message, a_target
from tests.bus.certificates import signing_keys
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
    """Start the program with this node's settings."""
    started = []

    def start(*arguments, program=PROGRAM):
        environment = os.environ | {
            "NODE_NAME": NODE,
            "ZENOH_CONNECT": address,
            "CGROUP_ROOT": str(tree.mount),
            "POD_LOGS": str(tree.logs),
            "PLAN_SIGNING": str(keys),
            "METRICS_PORT": str(free_port),
            "STATE_DIRECTORY": str(tmp_path / "state"),
            "PYTHONPATH": "operator",
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


def test_it_obeys_until_sigterm_and_undoes(start, operator, tree, slam):
    process = start()
    operator.publish(a_message(a_target(SLAM, 0.9)))
    until(lambda: tree.limit(slam) == 900)
    process.send_signal(signal.SIGTERM)
    assert process.wait(PATIENCE) == 0
    assert tree.limit(slam) == 500


def test_what_cannot_be_noted_is_not_done_until_it_can(start, operator, tree, slam, tmp_path):
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


def test_its_lock_is_free_when_it_is_killed_and_its_journal_says_what_to_undo(start, operator, tree, slam, tmp_path):
    process = start()
    operator.publish(a_message(a_target(SLAM, 0.9)))
    until(lambda: tree.limit(slam) == 900)
    state = StateDirectory(tmp_path / "state")
    assert not state.take_now()
    process.kill()
    process.wait(PATIENCE)
    assert state.take_now()
    assert state.anything_left


def test_it_ends_when_another_agent_lives_or_a_supervisor_undoes_for_too_long(start, tmp_path):
    state = StateDirectory(tmp_path / "state")
    assert state.take_now()
    process = start(program=IMPATIENT)
    _, said = process.communicate(timeout=PATIENCE)
    assert "agent.lock: held for 0.1 s" in said
    assert process.returncode == 1


def test_settings_that_make_no_sense_are_told(start):
    process = start("--priority", "500")
    _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode == 2
    assert "1..99" in said


def test_it_tells_whether_it_lives_and_what_it_does(start, operator, slam, free_port):  # noqa: ARG001
    start()
    operator.forge(a_message(a_target(SLAM, 0.1)))
    operator.publish(a_message(a_target(SLAM, 0.9)))
    until(lambda: "contextpolicy_agent_plan_seconds_count 1.0" in read(free_port, "metrics"))
    assert 'contextpolicy_agent_refusals_total{reason="Unsigned"} 1.0' in read(free_port, "metrics")
    assert read(free_port, "healthz") == "ok\n"


def read(port, page):
    with urlopen(f"http://127.0.0.1:{port}/{page}", timeout=PATIENCE) as answer:
        return answer.read().decode()
