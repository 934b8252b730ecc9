"""Robots' routers that join a fleet's: people see what all robots decide, and nothing goes from robot to robot."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
from contextlib import ExitStack, contextmanager
from queue import Empty, Queue

import pytest
import zenoh

from contextpolicy.bus.session import open_fleet_router, open_router
from tests.bus.certificates import Authority
from tests.bus.client import client_of
from tests.modules.robotkit.bus import ask
from tests.ports import free_port
from tests.waiting import PATIENCE

NEVER = 0.5
IMU = "robot/imu"


def plan_of(robot):
    return f"contextpolicy/{robot}/delivery/plan"


class Fleet:
    """Two robots, each with a router of its own, and a router that both join."""

    def __init__(self, authority, sessions):
        self._authority, self._sessions = authority, sessions
        self.place = {name: f"tls/127.0.0.1:{free_port()}" for name in ("fleet", "one", "two")}
        self.open_fleet()
        for robot in ("one", "two"):
            credentials = authority.issue("router", name=robot)
            up = [self.place["fleet"]]
            sessions.enter_context(open_router([self.place[robot]], credentials, uplink=up))

    def open_fleet(self):
        self.router = self._sessions.enter_context(
            open_fleet_router([self.place["fleet"]], self._authority.issue("viewer", name="fleet"))
        )

    def client(self, place, role):
        session = client_of(self.place[place], self._authority.issue(role))
        return self._sessions.enter_context(session)

    def heard(self, place, role, key):
        """A queue of what a client of this role hears there."""
        return follow(self.client(place, role), key)


def follow(session, key):
    """A queue of (key, text) that the session hears."""
    queue: Queue[tuple[str, str]] = Queue()
    session.declare_subscriber(key, lambda sample: queue.put((str(sample.key_expr), sample.payload.to_string())))
    return queue


@pytest.fixture
def fleet(tmp_path):
    with ExitStack() as sessions:
        yield Fleet(Authority(tmp_path), sessions)


def say_until(session, key, text, queue):
    """Say it until it arrives: a subscription takes a moment to reach the next router but one."""
    for _ in range(30):
        session.put(key, text)
        try:
            while queue.get(timeout=1.0) != (key, text):
                pass
        except Empty:
            continue
        return
    raise AssertionError(f"{text} was never heard")


def rest(queue):
    """All that is still to come."""
    found = []
    while True:
        try:
            found.append(queue.get(timeout=NEVER))
        except Empty:
            return found


def test_the_fleet_sees_what_every_robot_decides(fleet):
    seen = fleet.heard("fleet", "viewer", "contextpolicy/**")
    for robot in ("one", "two"):
        say_until(fleet.client(robot, "operator"), plan_of(robot), f"plan of {robot}", seen)


def test_the_fleet_may_ask_each_robot_why(fleet):
    key, viewer = "contextpolicy/one/delivery/explain", fleet.client("fleet", "viewer")
    fleet.client("one", "operator").declare_queryable(key, lambda query: query.reply(key, "it moves"))
    assert ask(viewer, key) == ["it moves"]


def test_robots_do_not_receive_each_others_messages(fleet):
    """Also where both call their sensors the same, as robots of one make do."""
    samples, plans = fleet.heard("two", "operator", "**"), fleet.heard("two", "agent", "contextpolicy/*/*/plan")
    seen = fleet.heard("fleet", "viewer", "contextpolicy/**")
    sensors = {robot: fleet.client(robot, "sensor") for robot in ("one", "two")}
    operators = {robot: fleet.client(robot, "operator") for robot in ("one", "two")}
    say_until(operators["one"], plan_of("two"), "of robot one", seen)
    say_until(sensors["two"], IMU, "of robot two", samples)
    sensors["one"].put(IMU, "of robot one")
    say_until(operators["two"], plan_of("two"), "of robot two", plans)
    assert {text for _, text in [*rest(samples), *rest(plans)]} <= {"of robot two"}


def test_the_fleet_cannot_publish_to_a_robot(fleet):
    heard = [fleet.heard("one", "operator", IMU), fleet.heard("one", "agent", "contextpolicy/*/*/plan")]
    seen = fleet.heard("fleet", "viewer", "contextpolicy/**")
    strangers = {role: fleet.client("fleet", role) for role in ("operator", "sensor", "module", "agent", "viewer")}
    say_until(fleet.client("one", "operator"), plan_of("one"), "real", seen)
    for (role, stranger), key in itertools.product(strangers.items(), (IMU, plan_of("one"), "**")):
        stranger.put(key, f"forged by {role}")
    say_until(fleet.client("one", "sensor"), IMU, "real", heard[0])
    assert {text for queue in heard for _, text in rest(queue)} <= {"real"}


def test_samples_stay_on_the_robot(fleet):
    overheard, seen = (fleet.heard("fleet", "viewer", key) for key in (IMU, "contextpolicy/**"))
    heard = fleet.heard("one", "operator", IMU)
    say_until(fleet.client("one", "sensor"), IMU, "sample", heard)
    say_until(fleet.client("one", "operator"), plan_of("one"), "plan", seen)
    assert rest(overheard) == []


def test_robot_continues_without_its_fleet_and_rejoins(fleet):
    """Robots leave the reach of their network, and fleets' routers are restarted."""
    operator = fleet.client("one", "operator")
    plans = fleet.heard("one", "agent", "contextpolicy/*/*/plan")
    fleet.router.close()
    say_until(operator, plan_of("one"), "alone", plans)
    fleet.open_fleet()
    say_until(operator, plan_of("one"), "joined", fleet.heard("fleet", "viewer", "contextpolicy/**"))


def test_hanging_fleet_router_does_not_block_a_robot(tmp_path):
    """All that is said arrives on the robot while nobody reads what is sent to the fleet, also from one who waits."""
    authority, up, here = Authority(tmp_path), f"tls/127.0.0.1:{free_port()}", f"tls/127.0.0.1:{free_port()}"
    with (
        open_router([here], authority.issue("router"), uplink=[up]),
        client_of(here, authority.issue("operator")) as operator,
        client_of(here, authority.issue("agent")) as agent,
        ExitStack() as end,
    ):
        fleet = end.enter_context(fleet_process(up, authority.issue("viewer", name="fleet")))
        viewer = end.enter_context(client_of(up, authority.issue("viewer")))
        end.callback(fleet.kill)  # first of all: a session takes leave of its router, and a frozen one never answers
        plans, seen = follow(agent, "contextpolicy/*/*/plan"), follow(viewer, "contextpolicy/**")
        say_until(operator, plan_of("one"), "first", seen)
        patient = operator.declare_publisher(plan_of("one"), congestion_control=zenoh.CongestionControl.BLOCK)
        fleet.send_signal(signal.SIGSTOP)
        for number in range(2000):
            patient.put(f"{number} {'x' * 4000}")
        heard = iter(lambda: plans.get(timeout=PATIENCE)[1].partition(" ")[0], "1999")
        assert set(heard) - {"first"} == {str(number) for number in range(1999)}


@contextmanager
def fleet_process(endpoint, credentials):
    """A fleet's router in a process of its own."""
    command = [sys.executable, "-m", "contextpolicy", "router", "--fleet", "--listen", endpoint]
    path = {"PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen([*command, "--credentials", str(credentials)], env={**os.environ, **path}) as process:
        yield process


def test_fleet_router_drops_oversized_messages(fleet):
    """A robot that was taken over must not fill the memory of who watches them all."""
    heard, robot = fleet.heard("fleet", "viewer", "contextpolicy/**"), fleet.client("fleet", "router")
    key = "contextpolicy/agents/node-1/confirmed"
    say_until(robot, key, "before", heard)
    for text in ("x" * 300_000, "after"):
        robot.put(key, text)
    while (said := heard.get(timeout=PATIENCE)[1]) == "before":
        pass
    assert said == "after"
