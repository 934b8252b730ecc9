from __future__ import annotations

import os
import socket
import threading
from contextlib import contextmanager
from queue import Queue

import pytest
from hypothesis import given
from hypothesis import strategies as st

from modules.navigation import open_interface as oi
from modules.navigation.guard import PASSED, PATIENCE, WAKE_EVERY, WAKE_S, Guard, Watch, brc_low
from modules.navigation.open_interface import Command, CommandParser, Opcode
from modules.navigation.simulator import Create2
from robotkit.simulated import on_a_pseudo_terminal
from tests import waiting

FORWARD = oi.drive_direct(right=200, left=200)


def test_a_steering_controller_is_not_lost():
    watch = Watch()
    for step in range(20):
        now = step * PATIENCE / 2
        assert watch.hear(FORWARD, now) == FORWARD
        assert not watch.lost(now + PATIENCE / 3)


def test_silence_while_the_wheels_turn_is_reported_once():
    watch = Watch()
    watch.hear(FORWARD, 0.0)
    assert watch.patience(0.2) == PATIENCE - 0.2
    assert watch.lost(PATIENCE)
    assert not watch.lost(PATIENCE + 1)
    assert watch.patience(PATIENCE + 1) is None


def test_silence_with_stopped_wheels_is_not_a_loss():
    watch = Watch()
    watch.hear(FORWARD + oi.HALT, 0.0)
    assert watch.patience(1.0) is None
    assert not watch.lost(100.0)


def test_sensor_queries_do_not_count_as_steering():
    watch = Watch()
    watch.hear(FORWARD, 0.0)
    watch.hear(oi.sensors(7), PATIENCE)
    assert watch.lost(PATIENCE)


@pytest.mark.parametrize("command", [oi.FULL, oi.RESET, oi.drive(200, oi.STRAIGHT), Command(Opcode.CLEAN).encode()])
def test_other_commands_are_blocked(command):
    assert Watch().hear(command, 0.0) == b""


def test_an_incomplete_command_is_held_back():
    watch = Watch()
    assert watch.hear(FORWARD[:3], 0.0) == b""
    assert watch.hear(FORWARD[3:], 0.0) == FORWARD


@given(st.lists(st.binary(max_size=50), max_size=5))
def test_only_whole_allowed_commands_pass(pieces):
    watch = Watch()
    parser = CommandParser()
    passed = b"".join(watch.hear(piece, 0.0) for piece in pieces)
    assert {command.opcode for command in parser.feed(passed)} <= PASSED
    assert not parser.waiting


def test_the_robot_is_kept_awake_by_one_long_pulse_a_minute():
    assert brc_low(0.0) == (True, WAKE_S)
    assert brc_low(WAKE_S) == (False, WAKE_EVERY - WAKE_S)
    assert brc_low(WAKE_EVERY + 0.25) == (True, WAKE_S - 0.25)


class Witness(Create2):
    """A robot that notes each time that its wheels begin to turn or to stand: who waits may be too slow to see it."""

    def __init__(self):
        super().__init__()
        self._changes: Queue[bool] = Queue()
        self._turning, self._shown = False, False
        self.receive(oi.START + oi.SAFE)

    def receive(self, data):
        answer = super().receive(data)
        self._notice()
        return answer

    def advance(self, seconds):
        frame = super().advance(seconds)
        self._notice()
        return frame

    def wait_for(self, *, turning):
        """From the change on that was waited for last."""
        while self._shown != turning:
            self._shown = self._changes.get(timeout=waiting.PATIENCE)

    def _notice(self):
        if any(self.wheels) != self._turning:
            self._turning = not self._turning
            self._changes.put(self._turning)


@contextmanager
def a_guarded_robot():
    robot = Witness()
    with on_a_pseudo_terminal(robot) as port, socket.create_server(("127.0.0.1", 0)) as server:
        guard = Guard(server, threading.Event())
        thread = threading.Thread(target=guard.run, args=(port,))
        thread.start()
        try:
            yield robot, guard, lambda: socket.create_connection(server.getsockname())
        finally:
            guard.wake()
            thread.join(waiting.PATIENCE)
            assert not thread.is_alive()


def test_wheels_stop_when_the_controller_disconnects():
    with a_guarded_robot() as (robot, _, connect):
        with connect() as controller:
            controller.sendall(FORWARD)
            robot.wait_for(turning=True)
        robot.wait_for(turning=False)


def test_wheels_stop_while_the_controller_is_silent():
    with a_guarded_robot() as (robot, _, connect), connect() as controller:
        controller.sendall(FORWARD)
        robot.wait_for(turning=True)
        robot.wait_for(turning=False)  # nobody says anything
        controller.sendall(FORWARD)
        robot.wait_for(turning=True)


def test_wheels_stop_when_the_guard_ends():
    with a_guarded_robot() as (robot, guard, connect), connect() as controller:
        controller.sendall(FORWARD)
        robot.wait_for(turning=True)
        guard.wake()
        robot.wait_for(turning=False)


def test_a_new_guard_stops_wheels_left_turning():
    robot = Witness()
    robot.receive(FORWARD + FORWARD[:3])
    robot.wait_for(turning=True)
    with on_a_pseudo_terminal(robot) as port, socket.create_server(("127.0.0.1", 0)) as server:
        guard = Guard(server, threading.Event())
        thread = threading.Thread(target=guard.run, args=(port,))
        thread.start()
        robot.wait_for(turning=False)
        guard.wake()
        thread.join(waiting.PATIENCE)


def test_the_guard_retries_a_missing_robot_until_it_ends(caplog):
    with socket.create_server(("127.0.0.1", 0)) as server:
        guard = Guard(server, threading.Event())
        thread = threading.Thread(target=guard.run, args=("/dev/nowhere",))
        thread.start()
        guard.wake()
        thread.join(waiting.PATIENCE)
    assert not thread.is_alive()
    assert os.path.exists("/dev/nowhere") is False  # noqa: PTH110
    assert all("cannot be opened" in message for message in caplog.messages)
