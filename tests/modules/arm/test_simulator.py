from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from modules.arm import servos
from modules.arm.servos import ErrorBit
from modules.arm.simulator import Maestro


def run(maestro, seconds):
    for _ in range(round(seconds / maestro.period)):
        maestro.advance(maestro.period)


def position(maestro, channel):
    return int.from_bytes(maestro.receive(servos.get_position(channel)), "little") / 4


def test_a_channel_sends_no_pulse_before_its_first_target():
    maestro = Maestro()
    run(maestro, 1)
    assert position(maestro, 0) == 0


def test_the_first_target_is_taken_at_once_whatever_the_speed():
    maestro = Maestro()
    maestro.receive(servos.set_speed(0, 100) + servos.set_target(0, 2000))
    assert position(maestro, 0) == 2000


def test_a_speed_limit_makes_the_users_guides_example():
    maestro = Maestro()
    maestro.receive(servos.set_target(5, 1000) + servos.set_speed(5, 3500) + servos.set_target(5, 1350))
    run(maestro, 0.05)
    assert position(maestro, 5) == 1175
    run(maestro, 0.05)
    assert position(maestro, 5) == 1350


def test_a_speed_limit_that_is_lifted_on_the_way_ends_it_at_once():
    maestro = Maestro()
    maestro.receive(servos.set_target(5, 1000) + servos.set_speed(5, 3500) + servos.set_target(5, 1350))
    run(maestro, 0.05)
    maestro.receive(servos._with_value(servos.Opcode.SET_SPEED, 5, 0))
    run(maestro, maestro.period)
    assert position(maestro, 5) == 1350


def test_going_home_ends_the_pulses():
    maestro = Maestro()
    maestro.receive(servos.set_target(1, 1500) + servos.GO_HOME)
    assert position(maestro, 1) == 0


def test_a_damaged_command_moves_nothing_and_is_remembered():
    maestro = Maestro()
    maestro.receive(servos.set_target(1, 1500)[:-1] + b"\x00")
    assert position(maestro, 1) == 0
    assert maestro.receive(servos.GET_ERRORS) == bytes([1 << ErrorBit.CRC, 0])
    assert maestro.receive(servos.GET_ERRORS) == bytes(2)


def test_a_servo_needs_half_a_second_for_half_a_turn():
    maestro = Maestro()
    maestro.servos[0] = 500
    maestro.receive(servos.set_target(0, 2400))
    run(maestro, 0.25)
    assert maestro.servos[0] == pytest.approx(1450, rel=0.02)


@given(st.binary(max_size=300))
def test_arbitrary_bytes_do_not_crash_it(noise):
    maestro = Maestro()
    maestro.receive(noise)
    maestro.advance(maestro.period)
