from __future__ import annotations

import json
import time
from unittest.mock import Mock

import pytest

from modules.navigation import packets
from modules.navigation.create2 import STREAMED, Create2, Sensors
from modules.navigation.odometry import Pose
from modules.navigation.packets import Frame
from modules.navigation.pilot import DRIVE_PATIENCE
from modules.navigation.task import Navigation
from modules.navigation.waypoints import STILL
from robotkit import MessageError, Received

ROUTE = {"waypoints": [[5, 0]]}
DRIVE = {"drive": {"forward": 0.2}}
FREE = {"ranges": [3.0] * 360}


def received(name, document, *, waited=0.0):
    """A sample that arrives now; `waited` is how long it was on its way, in s."""
    now = time.time_ns()
    return Received(json.dumps(document).encode(), now - round(waited * 1e9), now, name)


@pytest.fixture
def navigation():
    """It stands; its robot only remembers what it was told."""
    standing = Navigation("/dev/nowhere")
    standing._robot = Mock(Create2)
    return standing


def motion(navigation):
    """How the robot would move now."""
    safe = Sensors(0, 0, False, False, False, packets.SAFE_MODE, False, 15_000, -300, 0.8)  # noqa: FBT003
    return navigation._pilot.move(Pose(), [safe], time.monotonic())


def test_a_scan_that_waited_leaves_the_robot_blind(navigation):
    navigation.process(received("order", ROUTE))
    with pytest.raises(MessageError, match=r"scan: published 5\.\d s ago"):
        navigation.process(received("scan", FREE, waited=5))
    assert (motion(navigation), navigation._pilot.doing) == (STILL, "blind")
    navigation.process(received("scan", FREE, waited=0.2))
    assert motion(navigation) != STILL


def test_scans_of_a_clock_ahead_leave_the_robot_blind_and_are_reported(navigation):
    navigation.process(received("scan", FREE, waited=-5))  # a robot that stands needs no eyes
    navigation.process(received("order", ROUTE))
    with pytest.raises(MessageError, match=r"scan: its source's clock is 5\.0 s ahead"):
        navigation.process(received("scan", FREE))
    assert (motion(navigation), navigation._pilot.doing) == (STILL, "blind")


@pytest.mark.parametrize(("waited", "problem"), [(5, "published 5"), (-5, "ahead of this computer's")])
def test_a_drive_order_that_waited_neither_arms_nor_moves(navigation, waited, problem):
    with pytest.raises(MessageError, match=problem):
        navigation.process(received("order", DRIVE, waited=waited))
    assert not navigation._robot.arm.called
    assert (navigation._pilot.wanted, navigation._pilot.doing) == (False, "order expired")


def test_a_drive_order_holds_from_its_publication(navigation):
    navigation.process(received("order", DRIVE, waited=0.3))
    assert navigation._pilot._order.until - time.monotonic() <= DRIVE_PATIENCE - 0.3


def test_a_drive_order_that_waited_still_ends_the_order_before_it(navigation):
    navigation.process(received("order", ROUTE))
    with pytest.raises(MessageError):
        navigation.process(received("order", DRIVE, waited=5))
    assert not navigation._pilot.wanted
    assert navigation._robot.halt.called


def test_a_stop_is_obeyed_however_long_it_waited(navigation):
    navigation.process(received("order", ROUTE))
    navigation.process(received("order", {"stop": True}, waited=100))
    assert (navigation._pilot.wanted, navigation._pilot.doing) == (False, "stopped")


def test_sensors_that_waited_are_all_read():
    values = dict.fromkeys(STREAMED, 0)
    chunks = [Frame(STREAMED).encode(values | {packets.LEFT_ENCODER: count}) for count in range(3)]
    line = Mock(read=Mock(side_effect=[*chunks, b""]))
    assert [frame.left for frame in Create2(line).sensors()] == [0, 1, 2]
