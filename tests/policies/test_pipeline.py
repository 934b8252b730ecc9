"""Several plans and updates in flight: each receiver gets the newest, once and in order."""

from __future__ import annotations

import json
from hashlib import sha256

import pytest
from prometheus_client import REGISTRY

from contextpolicy.agent import node_orders
from contextpolicy.agent.admission import Admission
from contextpolicy.bus.agent_watch import AgentWatch
from contextpolicy.errors import OrderError
from tests.cluster.builders import NODE
from tests.planning.builders import a_context, a_task
from tests.policies.runner_rig import IMU, Robot

SCORED = [a_task("slam", max="600m", min="600m", activity=[{"scoreFrom": "imu.score"}]), a_task("speech")]
MOVING = a_context("moving", "imu.speed > 0.1", {"slam": {"weight": 4}})
BUSY = a_context("moving", "imu.speed > 0.1", {"speech": {"weight": 4}})
DARK = a_context("dark", "imu.light < 5.0", {"speech": {"weight": 3}})
CAPABLE = b'{"missing": {"CFS": [], "Realtime": []}}'


def with_agent(**spec):
    robot = Robot(**spec)
    robot.session.agents[NODE] = CAPABLE
    robot.begin()
    robot.loop.advance_by(5.0)
    for noted in (robot.orders.all, robot.contexts, robot.causes, robot.session.published):
        noted.clear()
    return robot


def stamps(robot):
    return [(message["sequence"], message["edition"]) for message in robot.session.plans()]


def are_in_order(stamps):
    return stamps == sorted(set(stamps))


def shown_weight(task):
    labels = {"namespace": "lab", "name": "robot", "task": task}
    return REGISTRY.get_sample_value("contextpolicy_task_weight", labels)


def two_plans(robot):
    """The second within the head start of the first."""
    robot.session.deliver(IMU, speed=0.3)
    robot.loop.advance_by(0.001)
    robot.place("slam", "speech", cpu=2000)
    robot.loop.advance_by(10.0)


# while agents have their head start


def test_each_plan_is_published_once():
    robot = with_agent()
    two_plans(robot)
    assert len(stamps(robot)) == 2
    assert are_in_order(stamps(robot))


def test_only_the_newest_plan_is_ordered():
    robot = with_agent()
    two_plans(robot)
    before, newest = (1000, 500, 500), (2000, 1600, 400)
    assert {(order.capacity[NODE], *order.shares.values()) for order in robot.orders.all} == {before, newest}


def test_editions_never_go_back():
    robot = with_agent(tasks=SCORED)
    robot.session.deliver(IMU, speed=0.3, score=1.0)
    robot.loop.advance_by(0.0005)
    robot.place("slam", "speech", cpu=2000)
    robot.loop.advance_by(0.0005)
    robot.session.deliver(IMU, speed=0.3, score=1.5)
    robot.loop.advance_by(10.0)
    assert are_in_order(stamps(robot))


def test_a_context_that_ends_by_a_timer_costs_no_more_messages():
    moving = a_context("moving", "imu.speed > 0.1", {"slam": {"weight": 4}}, exitAfter="100ms")
    robot = with_agent(contexts=[moving, DARK])
    robot.session.deliver(IMU, speed=0.3, light=9.0)
    robot.loop.advance_by(1.0)
    robot.session.published.clear()
    robot.session.deliver(IMU, speed=0.0, light=9.0)
    robot.loop.advance_by(0.098)
    robot.session.deliver(IMU, speed=0.0, light=1.0)
    robot.loop.advance_by(5)
    assert len(stamps(robot)) == 2
    assert are_in_order(stamps(robot))


def test_the_newest_plan_is_applied_when_agents_vanish():
    robot = with_agent(enforcement={"control": "Weight"})
    robot.session.deliver(IMU, speed=0.3)
    robot.loop.advance_by(0.001)
    robot.session.agents.clear()
    robot.place("slam", "speech")
    robot.session.deliver(IMU, speed=0.0)
    robot.loop.advance_by(10)
    assert are_in_order(stamps(robot))
    assert robot.orders.last.shares == {"lab/slam/slam": 500, "lab/speech/speech": 500}


def test_gauges_show_the_newest_weights():
    robot = with_agent(tasks=SCORED, contexts=[BUSY])
    for speed, score, lasts in ((0.0, 0.1, 5), (0.3, 0.2, 0.001), (0.3, 0.7, 100)):
        robot.session.deliver(IMU, speed=speed, score=score)
        robot.loop.advance_by(lasts)
    assert shown_weight("slam") == pytest.approx(0.7)


class AgentAtWork:
    """A real admission at the other end of the bus, and the operator's real watch over agents."""

    def __init__(self, robot):
        self._robot, self._seen, self._signed = robot, 0, 10**9
        self.refused: list[str] = []
        self.watch = AgentWatch(robot.session, robot.loop, self, {NODE})
        self._admission = Admission(lambda: 8)
        robot.agents, robot.session.confirming = self.watch, False

    def on_agents(self):
        """The robot's claim stays as it is."""

    def on_confirmation(self, node, said):
        """Nobody measures."""

    def on_trial(self, node):
        self._robot.runner.publisher.publish_to(node)

    def work(self, seconds, step):
        for _ in range(round(seconds / step)):
            self._robot.loop.advance_by(step)
            self._robot.session.answer()
            for message in self._robot.session.plans()[self._seen :]:
                self._take(message)

    def _take(self, message):
        self._seen += 1
        self._signed += 1
        for target in message["targets"]:
            target["containerId"] = f"containerd://{sha256(target['pod'].encode()).hexdigest()}"
        orders = node_orders.read(json.dumps(message).encode(), "lab/robot", NODE)
        try:
            self._admission.admit(orders, self._signed)
        except OrderError as error:
            self.refused.append(str(error))
        else:
            confirmed = json.dumps({"policy": "lab/robot", "stamp": orders.stamp}).encode()
            key = f"contextpolicy/agents/{NODE}/confirmed"
            self._robot.session.deliver_bytes("contextpolicy/agents/*/confirmed", confirmed, key)


def test_an_agent_accepts_all_plans_and_counts_as_alive():
    robot = Robot(tasks=SCORED, contexts=[BUSY])
    robot.session.agents[NODE] = CAPABLE
    agent = AgentAtWork(robot)
    robot.begin()
    agent.work(5.0, 0.05)
    robot.session.deliver(IMU, speed=0.3, score=1.0)
    agent.work(0.001, 0.0005)
    robot.place("slam", "speech", cpu=2000)
    agent.work(0.001, 0.0005)
    robot.session.deliver(IMU, speed=0.3, score=1.5)
    agent.work(1.5, 0.005)
    assert agent.refused == []
    assert not agent.watch.reports[NODE].limits


# updates of the plan in force


def test_contexts_are_reported_at_once_though_min_dwell_holds_the_plan():
    robot = Robot(contexts=[MOVING, DARK], enforcement={"minDwell": "10s"}).begin()
    robot.loop.advance_by(20)
    robot.sample(speed=0.3, light=9.0)
    robot.loop.advance_by(1.0)
    robot.sample(speed=0.0, light=9.0)
    for _ in range(3):
        robot.sample(speed=0.0, light=1.0)
        assert robot.contexts[-1] == ("dark", True)
        robot.loop.advance_by(0.05)
        robot.sample(speed=0.0, light=9.0)
    assert robot.contexts == [("moving", True), ("moving", False), *[("dark", True), ("dark", False)] * 3]


def test_a_context_is_reported_with_what_began_it():
    robot = with_agent(tasks=SCORED, contexts=[BUSY])
    robot.session.deliver(IMU, speed=0.3, score=0.1)
    robot.loop.advance_by(0.001)
    robot.session.deliver(IMU, speed=0.3, score=0.7)
    robot.loop.advance_by(5)
    assert robot.contexts == [("moving", True)]
    assert "context moving entered" in robot.causes[0]


def test_updates_among_plans_cost_no_more_messages():
    robot = Robot(tasks=SCORED, contexts=[BUSY]).begin()
    robot.sample(speed=0.0, score=0.1)
    robot.loop.advance_by(10)
    messages, plans = len(robot.session.plans()), len(robot.plans)
    for tick in range(500):  # 10 s at 50 Hz, and a context begins or ends each 200 ms
        robot.session.deliver(IMU, speed=0.3 * (tick // 10 % 2), score=0.2 + tick / 1000)
        robot.loop.advance_by(0.02)
    robot.loop.advance_by(1.0)
    assert len(robot.session.plans()) - messages <= len(robot.plans) - plans + 3


def test_gauges_show_an_update_that_comes_while_a_plan_waits():
    robot = Robot(tasks=SCORED, contexts=[BUSY]).begin()
    robot.sample(speed=0.0, score=0.1)
    robot.loop.advance_by(5)
    for speed, score in ((0.3, 0.2), (0.0, 0.3), (0.0, 0.7)):
        robot.session.deliver(IMU, speed=speed, score=score)
        robot.loop.advance_by(0.001)
    robot.loop.advance_by(100)
    assert shown_weight("slam") == pytest.approx(0.7)
