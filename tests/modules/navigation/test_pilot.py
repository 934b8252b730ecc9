from __future__ import annotations

import math

import pytest

from modules.navigation import packets
from modules.navigation.create2 import Sensors
from modules.navigation.odometry import Pose
from modules.navigation.pilot import ARMING_S, DRIVE_PATIENCE, SCAN_PATIENCE, Drive, Pilot
from modules.navigation.waypoints import CRUISE, STILL, Motion, Route

CLEAR = [0.0] * 360
BLOCKED = [0.3, *[0.0] * 359]
ORIGIN = Pose()


def sensors(**changes):
    calm = Sensors(0, 0, False, False, False, packets.SAFE_MODE, False, 15_000, -300, 0.8)  # noqa: FBT003
    return calm._replace(**changes)


def a_pilot(order=None, ranges=CLEAR):
    """One that got its order at 0 and saw a scan then."""
    pilot = Pilot()
    pilot.follow(order or Route([(5, 0)]), 0.0)
    pilot.see(ranges, 0.0)
    return pilot


def test_it_stands_still_without_an_order():
    assert Pilot().move(ORIGIN, [sensors()], 0.0) == STILL


def test_it_drives_to_a_waypoint_and_arrives():
    pilot = a_pilot()
    assert pilot.move(ORIGIN, [sensors()], 0.1) == Motion(CRUISE, 0)
    assert pilot.doing == "driving"
    assert pilot.move(Pose(5, 0, 0), [sensors()], 0.1) == STILL
    assert (pilot.doing, pilot.wanted) == ("arrived", False)


def test_it_waits_while_scans_are_missing():
    pilot = a_pilot()
    late = SCAN_PATIENCE + 0.01
    assert pilot.move(ORIGIN, [sensors()], late) == STILL
    assert (pilot.doing, pilot.wanted) == ("blind", True)
    pilot.see(CLEAR, late)
    assert pilot.move(ORIGIN, [sensors()], late) != STILL


def test_the_robot_does_not_drive_before_a_scan():
    pilot = Pilot()
    pilot.follow(Route([(5, 0)]), 0.0)
    assert pilot.move(ORIGIN, [sensors()], 0.0) == STILL


def test_it_waits_until_an_obstacle_is_gone():
    pilot = a_pilot(ranges=BLOCKED)
    assert pilot.move(ORIGIN, [sensors()], 0.1) == STILL
    assert (pilot.doing, pilot.wanted) == ("obstacle", True)
    pilot.see(CLEAR, 0.1)
    assert pilot.move(ORIGIN, [sensors()], 0.1) != STILL


@pytest.mark.parametrize(
    ("hazard", "why"),
    [
        ({"bumped": True}, "bumped"),
        ({"lifted": True}, "lifted"),
        ({"cliff": True}, "cliff"),
        ({"mode": packets.PASSIVE}, "disarmed"),
    ],
)
def test_a_hazard_ends_the_order_also_when_it_passed_between_two_cycles(hazard, why):
    pilot = a_pilot()
    now = ARMING_S + 0.1
    assert pilot.move(ORIGIN, [sensors(), sensors(**hazard), sensors()], now) == STILL
    assert pilot.doing == why
    assert pilot.move(ORIGIN, [sensors()], now) == STILL


def test_a_robot_that_is_just_being_armed_is_not_disarmed():
    pilot = a_pilot()
    assert pilot.move(ORIGIN, [sensors(mode=packets.PASSIVE)], ARMING_S / 2) != STILL


def test_manual_control_expires_without_heartbeat():
    pilot = a_pilot(Drive(Motion(0.1, 0.2), until=DRIVE_PATIENCE))
    assert pilot.move(ORIGIN, [sensors()], 0.4) == Motion(0.1, 0.2)
    assert pilot.move(ORIGIN, [sensors()], DRIVE_PATIENCE + 0.01) == STILL
    assert pilot.doing == "order expired"


def test_after_a_bump_it_may_be_driven_backward_by_hand():
    pilot = a_pilot(Drive(Motion(-0.1), until=1.0))
    assert pilot.move(ORIGIN, [sensors(bumped=True)], 0.1) == Motion(-0.1)


def test_obstacles_behind_stop_backward_driving():
    behind = [0.0] * 360
    behind[180] = 0.3
    pilot = a_pilot(Drive(Motion(-0.1), until=1.0), ranges=behind)
    assert pilot.move(ORIGIN, [sensors()], 0.1) == STILL


def test_an_ended_order_stays_ended():
    pilot = a_pilot()
    pilot.end("stopped")
    assert pilot.move(ORIGIN, [sensors()], 0.1) == STILL
    assert (pilot.doing, pilot.waypoints_left, pilot.gap) == ("stopped", 0, math.inf)
