from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from modules.navigation import open_interface as oi
from modules.navigation import packets
from modules.navigation.odometry import WHEEL_BASE, Odometry
from modules.navigation.open_interface import Command, Opcode
from modules.navigation.packets import Reading, StreamParser
from modules.navigation.simulator import BOOT_MESSAGE, SPEED_STEP, Body, Create2

ALL = [packets.BUMPS_AND_DROPS, packets.OI_MODE, packets.LEFT_ENCODER, packets.RIGHT_ENCODER]
FORWARD = oi.drive_direct(right=200, left=200)


def a_robot(*, mode=oi.SAFE, body=None):
    robot = Create2(body)
    robot.receive(oi.START + mode)
    return robot


def run(robot, seconds):
    return b"".join(robot.advance(robot.period) for _ in range(round(seconds / robot.period)))


def test_commands_before_start_are_ignored():
    robot = Create2()
    assert robot.receive(oi.SAFE + FORWARD + oi.sensors(35)) == b""
    assert robot.wheels == (0, 0)
    assert robot.receive(oi.START + oi.sensors(35)) == bytes([packets.PASSIVE])


def test_passive_mode_does_not_drive():
    robot = Create2()
    robot.receive(oi.START + FORWARD)
    assert robot.wheels == (0, 0)


@pytest.mark.parametrize(("mode", "value"), [(oi.SAFE, packets.SAFE_MODE), (oi.FULL, packets.FULL_MODE)])
def test_safe_and_full_mode_drive(mode, value):
    robot = a_robot(mode=mode)
    robot.receive(FORWARD)
    run(robot, 1.5)
    assert robot.mode == value
    assert robot.body.pose.x == pytest.approx(0.3, rel=0.05)


def test_speeds_come_in_steps():
    robot = a_robot()
    robot.receive(oi.drive_direct(right=40, left=13))
    assert robot.wheels == (0.0, pytest.approx(SPEED_STEP / 1000))


@pytest.mark.parametrize(
    ("command", "left", "right"),
    [
        (oi.drive(228, oi.STRAIGHT), 228, 228),
        (oi.drive(228, oi.CLOCKWISE), 228, -228),
        (oi.drive(228, oi.COUNTER_CLOCKWISE), -228, 228),
        (oi.drive(-200, 500), -153, -247),
        (Command(Opcode.DRIVE_PWM, (255, -255)).encode(), -500, 500),
    ],
)
def test_the_other_ways_to_drive(command, left, right):
    robot = a_robot()
    robot.receive(command)
    assert [wheel * 1000 for wheel in robot.wheels] == pytest.approx([left, right], abs=SPEED_STEP)


def test_a_wheel_drop_and_a_cliff_end_safe_mode_with_the_wheels_stopped():
    for hazard in ({"drops": packets.DROP_LEFT}, {"cliff": True}):
        robot = a_robot()
        robot.receive(FORWARD)
        for name, value in hazard.items():
            setattr(robot, name, value)
        robot.advance(robot.period)
        assert (robot.mode, robot.wheels) == (packets.PASSIVE, (0, 0))


def test_full_mode_ignores_a_cliff():
    robot = a_robot(mode=oi.FULL)
    robot.receive(FORWARD)
    robot.cliff = True
    robot.advance(robot.period)
    assert robot.wheels != (0, 0)


def test_a_bump_does_not_stop_the_wheels():
    robot = a_robot(body=Body(walls=[(0.5, -1, 0.5, 1)]))
    robot.receive(FORWARD)
    run(robot, 4)
    assert robot.values()[packets.BUMPS_AND_DROPS] == packets.BUMP_LEFT | packets.BUMP_RIGHT
    assert robot.wheels != (0, 0)
    assert robot.body.pose.x < 0.5


def test_it_keeps_driving_without_further_commands():
    robot = a_robot()
    robot.receive(FORWARD)
    run(robot, 600)
    assert robot.body.pose.x > 100


@pytest.mark.parametrize("command", [oi.STOP, oi.RESET, oi.START, oi.HALT])
def test_stop_reset_start_and_halt_stop_the_wheels(command):
    robot = a_robot()
    robot.receive(FORWARD)
    robot.receive(command)
    assert robot.wheels == (0, 0)


def test_reset_prints_its_firmware_and_is_off():
    robot = a_robot()
    assert robot.receive(oi.RESET) == BOOT_MESSAGE
    assert robot.mode == packets.OFF


def test_it_waits_for_the_rest_of_a_command():
    robot = a_robot()
    robot.receive(FORWARD[:3])
    robot.receive(oi.HALT)
    assert robot.wheels != (0, 0)  # the halt was taken for data
    robot.receive(oi.RESYNC + oi.HALT)
    assert robot.wheels == (0, 0)


def test_a_stream_comes_every_15_ms_until_it_is_paused():
    robot = a_robot()
    robot.receive(oi.stream(ALL))
    assert len(StreamParser(ALL).feed(run(robot, 0.3))) == 20
    robot.receive(oi.pause_stream())
    assert run(robot, 0.3) == b""
    robot.receive(Command(Opcode.PAUSE_RESUME_STREAM, (1,)).encode())
    assert len(StreamParser(ALL).feed(run(robot, 0.15))) == 10


def test_a_query_is_answered_in_order():
    robot = a_robot()
    answer = robot.receive(Command(Opcode.QUERY_LIST, (packets.VOLTAGE, packets.OI_MODE)).encode())
    assert Reading([22, 35]).decode(answer) == {22: 15_800, 35: packets.SAFE_MODE}


def test_encoders_roll_over():
    robot = a_robot(body=Body(counts=[32767.0, 32767.0]))
    robot.receive(FORWARD)
    run(robot, 1)
    assert robot.values()[packets.LEFT_ENCODER] < -32000


@given(st.binary(max_size=300))
def test_arbitrary_bytes_do_not_crash_it(noise):
    robot = a_robot()
    robot.receive(noise)
    robot.advance(robot.period)


def test_odometry_follows_the_simulated_robot_within_its_counts():
    robot = a_robot()
    odometry = Odometry()
    for right, left, seconds in [(200, 200, 10), (200, 100, 10), (-200, 200, 3), (300, 300, 20)]:
        robot.receive(oi.drive_direct(right=right, left=left))
        for _ in range(round(seconds / robot.period)):
            robot.advance(robot.period)
            values = robot.values()
            odometry.update(values[packets.LEFT_ENCODER], values[packets.RIGHT_ENCODER])
    true, reported = robot.body.pose, odometry.pose
    assert math.dist((true.x, true.y), (reported.x, reported.y)) < 0.002 * odometry.travelled


def asked(robot, packet, code="h"):
    (value,) = struct.unpack(f">{code}", robot.receive(oi.sensors(packet)))
    return value


def test_distance_and_angle_count_since_they_were_last_sent():
    robot = a_robot()
    robot.receive(oi.drive_direct(right=200, left=200))
    run(robot, 1.5)
    assert asked(robot, packets.DISTANCE) == pytest.approx(300, abs=15)
    assert asked(robot, packets.DISTANCE) == 0
    assert asked(robot, packets.ANGLE) == 0
    robot.receive(oi.drive_direct(right=100, left=-100))
    run(robot, 1.5)
    assert asked(robot, packets.ANGLE) == pytest.approx(math.degrees(0.3 / WHEEL_BASE), rel=0.2)
    assert asked(robot, packets.DISTANCE) == 0
    robot.receive(oi.drive_direct(right=-200, left=-200))
    run(robot, 0.3)
    assert asked(robot, packets.DISTANCE) < 0


def test_distance_adds_up_over_many_queries():
    robot = a_robot()
    robot.receive(oi.drive_direct(right=100, left=100))
    reported = 0
    for _ in range(100):
        robot.advance(robot.period)
        reported += asked(robot, packets.DISTANCE)
    assert reported == pytest.approx(100 * robot.period * 114, abs=1)  # the controller's step next to 100 mm/s


def test_a_distance_that_no_packet_holds_is_capped():
    robot = a_robot(mode=oi.FULL)
    robot.receive(oi.drive_direct(right=500, left=500))
    run(robot, 75)
    assert asked(robot, packets.DISTANCE) == 32767


def test_requested_speeds_are_reported_as_requested():
    robot = a_robot()
    robot.receive(oi.drive(velocity=203, radius=500))
    assert (asked(robot, packets.REQUESTED_VELOCITY), asked(robot, packets.REQUESTED_RADIUS)) == (203, 500)
    robot.receive(oi.drive_direct(right=-7, left=11))
    assert (asked(robot, packets.REQUESTED_RIGHT), asked(robot, packets.REQUESTED_LEFT)) == (-7, 11)


def test_a_song_plays_as_long_as_its_notes():
    robot = a_robot()
    robot.receive(Command(Opcode.PLAY, (2,)).encode())
    assert asked(robot, packets.SONG_PLAYING, "B") == 0  # nobody wrote it
    robot.receive(Command(Opcode.SONG, (2, 60, 32, 64, 32)).encode())  # one second
    robot.receive(Command(Opcode.SONG, (3, 60, 1)).encode())
    robot.receive(Command(Opcode.PLAY, (2,)).encode())
    run(robot, 0.9)
    robot.receive(Command(Opcode.PLAY, (3,)).encode())  # ignored while one plays
    assert (asked(robot, packets.SONG_NUMBER, "B"), asked(robot, packets.SONG_PLAYING, "B")) == (2, 1)
    run(robot, 0.2)
    assert asked(robot, packets.SONG_PLAYING, "B") == 0


def test_passive_mode_ignores_songs_and_drive_commands():
    robot = Create2()
    robot.receive(oi.START + Command(Opcode.SONG, (0, 60, 64)).encode() + Command(Opcode.PLAY, (0,)).encode())
    robot.receive(oi.drive_direct(right=100, left=100))
    assert (asked(robot, packets.SONG_PLAYING, "B"), asked(robot, packets.REQUESTED_RIGHT)) == (0, 0)
