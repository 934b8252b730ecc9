from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from modules.navigation import open_interface as oi
from modules.navigation.open_interface import Command, CommandParser, Opcode

ARGUMENTS = {
    Opcode.BAUD: [(0, 11)],
    Opcode.DRIVE: [(-500, 500), (-32768, 32767)],
    Opcode.DRIVE_DIRECT: [(-500, 500)] * 2,
    Opcode.DRIVE_PWM: [(-255, 255)] * 2,
    Opcode.MOTORS: [(0, 31)],
    Opcode.PWM_MOTORS: [(-127, 127)] * 3,
    Opcode.LEDS: [(0, 255)] * 3,
    Opcode.PLAY: [(0, 4)],
    Opcode.SENSORS: [(0, 255)],
    Opcode.PAUSE_RESUME_STREAM: [(0, 1)],
    Opcode.SCHEDULING_LEDS: [(0, 255)] * 2,
    Opcode.DIGIT_LEDS_RAW: [(0, 255)] * 4,
    Opcode.DIGIT_LEDS_ASCII: [(32, 126)] * 4,
    Opcode.BUTTONS: [(0, 255)],
    Opcode.SCHEDULE: [(0, 255)] * 15,
    Opcode.SET_DAY_TIME: [(0, 59)] * 3,
}


@st.composite
def commands(draw):
    opcode = draw(st.sampled_from(Opcode))
    if opcode in {Opcode.STREAM, Opcode.QUERY_LIST}:
        return Command(opcode, tuple(draw(st.lists(st.integers(0, 255), max_size=20))))
    if opcode is Opcode.SONG:
        notes = draw(st.lists(st.tuples(st.integers(31, 127), st.integers(0, 255)), max_size=16))
        return Command(opcode, (draw(st.integers(0, 4)), *(number for note in notes for number in note)))
    return Command(opcode, tuple(draw(st.integers(*limits)) for limits in ARGUMENTS.get(opcode, [])))


@pytest.mark.parametrize(
    ("command", "sequence"),
    [
        (oi.drive(-200, 500), [137, 255, 56, 1, 244]),
        (Command(Opcode.QUERY_LIST, (7, 13)).encode(), [149, 2, 7, 13]),
        (oi.stream([29, 13]), [148, 2, 29, 13]),
        (Command(Opcode.LEDS, (4, 0, 128)).encode(), [139, 4, 0, 128]),
        (Command(Opcode.MOTORS, (13,)).encode(), [138, 13]),
        (Command(Opcode.DIGIT_LEDS_ASCII, (65, 66, 67, 68)).encode(), [164, 65, 66, 67, 68]),
        (
            Command(Opcode.SCHEDULE, (40, 0, 0, 0, 0, 0, 0, 15, 0, 0, 0, 10, 36, 0, 0)).encode(),
            [167, 40, 0, 0, 0, 0, 0, 0, 15, 0, 0, 0, 10, 36, 0, 0],
        ),
    ],
)
def test_the_examples_of_the_specification(command, sequence):
    assert list(command) == sequence


@pytest.mark.parametrize(
    ("command", "sequence"),
    [
        (oi.START, [128]),
        (oi.SAFE, [131]),
        (oi.FULL, [132]),
        (oi.STOP, [173]),
        (oi.RESET, [7]),
        (oi.HALT, [145, 0, 0, 0, 0]),
        (oi.sensors(100), [142, 100]),
        (oi.pause_stream(), [150, 0]),
        (oi.drive(200, oi.STRAIGHT), [137, 0, 200, 0x80, 0]),
        (oi.drive(100, oi.CLOCKWISE), [137, 0, 100, 0xFF, 0xFF]),
        (oi.drive(100, oi.COUNTER_CLOCKWISE), [137, 0, 100, 0, 1]),
        (Command(Opcode.DRIVE_PWM, (-255, 255)).encode(), [146, 0xFF, 0x01, 0, 0xFF]),
    ],
)
def test_the_serial_sequences_of_the_specification(command, sequence):
    assert list(command) == sequence


def test_the_right_wheel_comes_first():
    assert list(oi.drive_direct(right=-200, left=500)) == [145, 255, 56, 1, 244]


@pytest.mark.parametrize(
    ("build", "problem"),
    [
        (lambda: oi.drive(501, 0), "velocity: invalid value 501: expected -500 to 500"),
        (lambda: oi.drive(0, 2001), "radius: invalid value 2001: expected -2000 to 2000"),
        (lambda: oi.drive_direct(right=0, left=-501), "left: invalid value -501: expected -500 to 500"),
    ],
)
def test_a_speed_that_the_robot_does_not_know_is_refused(build, problem):
    with pytest.raises(ValueError, match=problem):
        build()


@given(st.lists(commands(), max_size=8), st.data())
def test_commands_round_trip_however_they_are_split(sent, data):
    wire = b"".join(command.encode() for command in sent)
    cut = data.draw(st.integers(0, len(wire)))
    parser = CommandParser()
    assert parser.feed(wire[:cut]) + parser.feed(wire[cut:]) == sent
    assert not parser.waiting


@given(st.binary(max_size=400))
def test_zeros_resynchronise_the_parser_after_noise(noise):
    parser = CommandParser()
    parser.feed(noise)
    parser.feed(oi.RESYNC * 3)  # a song of 255 notes has 513 bytes
    assert not parser.waiting
    assert parser.feed(oi.HALT) == [Command(Opcode.DRIVE_DIRECT, (0, 0))]


def test_a_command_that_was_cut_off_swallows_the_next_unless_zeros_end_it():
    parser = CommandParser()
    parser.feed(oi.drive_direct(right=200, left=200)[:3])
    assert parser.feed(oi.HALT) != [Command(Opcode.DRIVE_DIRECT, (0, 0))]
    parser.feed(oi.RESYNC)
    assert parser.feed(oi.HALT) == [Command(Opcode.DRIVE_DIRECT, (0, 0))]
