"""The agent as a program: from signal to exit code, with what it leaves behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from contextpolicy.bus.decision_bus import plan_key
from tests.agent.builders import NODE, SLAM, Tree, a_message, a_target
from tests.modules.robotkit.bus import Matching, client, router

KEY = plan_key("robot", "delivery")
PATIENCE = 20


@pytest.fixture
def address():
    with router() as address:
        yield address


@pytest.fixture
def session(address):
    with client(address) as session:
        yield session


@pytest.fixture
def publisher(session):
    return session.declare_publisher(KEY)


@pytest.fixture
def tree(tmp_path):
    return Tree(tmp_path / "cgroup")


@pytest.fixture
def slam(tree):
    return tree.container(SLAM)


@pytest.fixture
def start(tmp_path, tree, address):
    """Start the program with this node's settings."""
    started = []

    def start(*arguments):
        environment = os.environ | {
            "NODE_NAME": NODE,
            "ZENOH_CONNECT": address,
            "CGROUP_ROOT": str(tree.mount),
            "STATE_DIRECTORY": str(tmp_path / "state"),
            "PYTHONPATH": "operator",
        }
        command = [sys.executable, "-m", "contextpolicy", "agent", *arguments]
        process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


def until(condition):
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_it_obeys_until_sigterm_and_undoes(start, publisher, tree, slam):
    process = start()
    Matching(publisher).wait(expected=True)
    publisher.put(a_message(a_target(SLAM, 0.9)))
    until(lambda: tree.limit(slam) == 900)
    process.send_signal(signal.SIGTERM)
    assert process.wait(PATIENCE) == 0
    assert tree.limit(slam) == 500


def test_after_sigkill_its_successor_undoes(start, publisher, tree, slam):
    process = start()
    Matching(publisher).wait(expected=True)
    publisher.put(a_message(a_target(SLAM, 0.9)))
    until(lambda: tree.limit(slam) == 900)
    process.kill()
    process.wait(PATIENCE)
    assert tree.limit(slam) == 900
    start("--grace", "0.1")
    until(lambda: tree.limit(slam) == 500)


def test_what_cannot_be_noted_is_not_done(start, publisher, tree, slam, tmp_path):
    """A full or missing disk: better no faster limit than one that nobody could undo."""
    process = start()
    Matching(publisher).wait(expected=True)
    (tmp_path / "state").rmdir()
    publisher.put(a_message(a_target(SLAM, 0.9)))
    assert any("FileNotFoundError" in line for line in process.stderr)
    assert tree.limit(slam) == 500


def test_settings_that_make_no_sense_are_told(start):
    process = start("--priority", "500")
    _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode == 2
    assert "1..99" in said
