from __future__ import annotations

import json
import math
import queue
import threading
import time
from contextlib import contextmanager
from typing import Any

import pytest

from modules.lidar.simulator import seen
from modules.navigation import open_interface as oi
from modules.navigation import packets
from modules.navigation.simulator import Body
from modules.navigation.task import Navigation
from robotkit import UNPLANNED, Decision, DeviceError, Received
from robotkit.simulated import on_a_pseudo_terminal
from tests.modules.navigation.test_guard import Witness
from tests.waiting import PATIENCE, until

AHEAD = {"waypoints": [[5, 0]]}


class World:
    """Navigation at work on a simulated robot, and what it publishes."""

    def __init__(self, robot, navigation):
        self.robot = robot
        self.navigation = navigation
        self.results: queue.Queue[Any] = queue.Queue()
        self.failed: queue.Queue[Exception] = queue.Queue()
        self.ended = threading.Event()

    def work(self):
        try:
            for result in self.navigation.produce(self.ended):
                self.results.put(result)
        except DeviceError as error:
            self.failed.put(error)

    def order(self, order):
        self.navigation.process(received("order", order))

    def set_out(self):
        """Drive ahead. On a busy machine an order may end because the robot was not in Safe mode soon enough."""

        def turns():
            if not self.navigation._pilot.wanted:
                self.order(AHEAD)
            return any(self.robot.wheels)

        until(turns)
        self.robot.wait_for(turning=True)

    def see(self, distance=3.0):
        self.navigation.process(received("scan", {"ranges": [distance] * 360}))

    def hear_anew(self):
        """Wait until no frame is under way that was sent before now: two odometry results are 0.4 s."""
        with self.results.mutex:
            self.results.queue.clear()
        for _ in range(3):
            self.next("odometry")

    def next(self, output, **expected):
        """Wait for a result that says what is expected."""
        deadline = time.monotonic() + PATIENCE
        while True:
            result = self.results.get(timeout=max(deadline - time.monotonic(), 0.01))
            if result.output == output and all(result.value[name] == value for name, value in expected.items()):
                return result.value


def received(name, document):
    now = time.time_ns()
    return Received(json.dumps(document).encode(), now, now, name)


@contextmanager
def a_driving_robot(body=None):
    """Its lidar sees nothing but 3 m of free space, five times a second."""
    robot = Witness()
    robot.body = body or Body()
    with on_a_pseudo_terminal(robot) as port:
        world = World(robot, Navigation(port))
        threads = [threading.Thread(target=world.work), threading.Thread(target=watch, args=(world,))]
        for thread in threads:
            thread.start()
        world.next("odometry")
        try:
            world.set_out()
            yield world
        finally:
            world.ended.set()
            for thread in threads:
                thread.join(PATIENCE)


def watch(world):
    while not world.ended.wait(0.1):
        pose = world.robot.body.pose
        ranges = [seen(world.robot.body.walls, pose.x, pose.y, pose.heading + math.radians(at)) for at in range(360)]
        free = [0.0 if distance == math.inf else distance for distance in ranges]
        world.navigation.process(received("scan", {"ranges": free}))


def test_it_drives_and_publishes_odometry():
    with a_driving_robot() as world:
        where = world.next("odometry", forward=pytest.approx(0.2, abs=0.05))
        state = world.next("state", doing="driving")
    assert where["position"][1] == pytest.approx(0, abs=0.01)
    assert (state["mode"], state["waypoints"], state["charging"]) == ("safe", 1, False)
    assert state["battery"] == pytest.approx(0.816, abs=0.001)


@pytest.mark.parametrize(
    "stop",
    [
        lambda world: world.order({"stop": True}),
        lambda world: world.navigation.adapt(Decision(share=0.01, weight=0, suspended=True)),
        lambda world: world.navigation.close(),
        lambda world: world.ended.set(),
    ],
    ids=["stop order", "suspended", "closed", "ended"],
)
def test_wheels_stop_at_once(stop):
    with a_driving_robot() as world:
        stop(world)
        world.robot.wait_for(turning=False)
        assert not world.navigation._pilot.wanted


def test_a_smaller_share_does_not_stop_it():
    with a_driving_robot() as world:
        world.navigation.adapt(Decision(share=0.01, weight=1))
        world.navigation.adapt(UNPLANNED)
        assert world.navigation._pilot.wanted


def test_it_stops_before_a_wall():
    with a_driving_robot(Body(walls=[(0.5, -1, 0.5, 1)])) as world:
        world.robot.wait_for(turning=False)
        world.next("state", doing="obstacle")
        assert world.robot.body.bumps == 0
        assert 0.05 < world.robot.body.pose.x < 0.5 - 0.174


def test_a_lifted_robot_stops_until_the_next_order():
    with a_driving_robot() as world:
        world.robot.drops = packets.DROP_LEFT | packets.DROP_RIGHT
        world.next("state", doing="lifted", mode="passive")
        world.robot.drops = 0
        world.robot.wait_for(turning=False)
        world.hear_anew()
        world.set_out()


def test_a_robot_that_falls_silent_is_a_device_error():
    with a_driving_robot() as world:
        world.robot.receive(oi.STOP)
        assert "no sensor data for 1 s: check that the robot is on" in str(world.failed.get(timeout=PATIENCE))


def test_noise_on_the_line_is_counted_and_the_drive_continues():
    with a_driving_robot() as world:
        encode, noisy = world.robot._frame.encode, iter(range(10**6))
        world.robot._frame.encode = lambda values: encode(values)[next(noisy) % 3 == 0 :] + b"\x13\x24"
        world.next("state")
        assert world.next("state", doing="driving")["skipped"] > 0


def test_an_order_without_a_robot_is_a_device_error_but_a_stop_is_not():
    navigation = Navigation("/dev/nowhere")
    navigation.process(received("order", {"stop": True}))
    with pytest.raises(DeviceError, match="no robot is connected"):
        navigation.process(received("order", AHEAD))
