from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from modules.arm import servos
from modules.arm.servos import Command, CommandParser, ErrorBit, Opcode, crc7

WITH_VALUE = (Opcode.SET_TARGET, Opcode.SET_SPEED, Opcode.SET_ACCELERATION)
COMMANDS = st.one_of(
    st.builds(Command, st.sampled_from(WITH_VALUE), st.integers(0, 23), st.integers(0, servos.MAX_VALUE)),
    st.builds(Command, st.just(Opcode.GET_POSITION), st.integers(0, 23)),
    st.builds(Command, st.sampled_from((Opcode.GET_ERRORS, Opcode.GO_HOME))),
)


@pytest.mark.parametrize(
    ("command", "sequence"),
    [
        (servos.set_target(2, 1500), "84 02 70 2e"),  # section 5.e
        (servos.set_target(0, 1500), "84 00 70 2e"),  # section 5.c
        (servos.set_speed(5, 3500), "87 05 0c 01"),  # section 5.e: 140, which is 3.5 us per ms
        (servos.get_position(0), "90 00"),
        (servos.GET_ERRORS, "a1"),
        (servos.GO_HOME, "a2"),
    ],
)
def test_the_examples_of_the_users_guide(command, sequence):
    assert command[:-1].hex(" ") == sequence
    assert command[-1] == crc7(bytes.fromhex(sequence))


@pytest.mark.parametrize(("message", "remainder"), [("83 01", 0x17), ("d1 01 64 00", 0x68)])
def test_the_crc_of_pololus_examples(message, remainder):
    assert crc7(bytes.fromhex(message)) == remainder


def test_a_small_speed_limit_is_not_rounded_to_unlimited():
    assert servos.set_speed(0, 0.1)[2:4] == bytes([1, 0])


@pytest.mark.parametrize("pulse", [-1, 4096])
def test_a_pulse_that_does_not_fit_is_refused(pulse):
    with pytest.raises(ValueError, match=r"set_target of channel 1: invalid value .*: expected 0 to 16383"):
        servos.set_target(1, pulse)


@given(st.lists(COMMANDS, max_size=8), st.data())
def test_commands_round_trip_however_they_are_split(sent, data):
    wire = b"".join(command.encode() for command in sent)
    cut = data.draw(st.integers(0, len(wire)))
    parser = CommandParser()
    assert parser.feed(wire[:cut]) + parser.feed(wire[cut:]) == sent
    assert parser.errors == 0


@given(st.binary(max_size=200), COMMANDS)
def test_the_next_command_after_noise_is_decoded(noise, command):
    parser = CommandParser()
    parser.feed(noise)
    assert parser.feed(command.encode()) == [command]


@given(COMMANDS, st.data())
def test_a_corrupted_byte_fails_the_crc(command, data):
    packet = bytearray(command.encode())
    at = data.draw(st.integers(1, len(packet) - 1))
    packet[at] ^= data.draw(st.integers(1, 127))
    parser = CommandParser()
    assert parser.feed(bytes(packet)) == []
    assert parser.take_errors() == 1 << ErrorBit.CRC
    assert parser.take_errors() == 0


def test_a_command_that_was_cut_off_is_an_error_of_its_own():
    parser = CommandParser()
    assert parser.feed(servos.set_target(0, 1500)[:2] + servos.GO_HOME) == [Command(Opcode.GO_HOME)]
    assert parser.errors == 1 << ErrorBit.PROTOCOL
