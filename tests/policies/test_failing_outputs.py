"""An output that raises affects neither the others nor the planner's timers, and is tried again."""

from __future__ import annotations

from threading import Event

import pytest

from contextpolicy.policies.policy_runner import PolicyRunner
from contextpolicy.streams.persisting import RETRY
from tests.cluster.builders import NODE
from tests.planning.builders import a_stream
from tests.policies.runner_rig import IMU, Robot
from tests.policies.test_pipeline import CAPABLE, are_in_order, stamps

OUTPUTS = ("instruct_agents", "order", "report", "show", "report_contexts")
SILENT = {"streams": [a_stream("imu", staleAfter="2s")]}


@pytest.fixture
def failing(monkeypatch):
    """Make a method raise the next time that it is called after `due` was set."""

    def make(owner, name):
        real, due = getattr(owner, name), Event()

        def act(*own):
            if due.is_set():
                due.clear()
                raise KeyError("broken")
            return real(*own)

        monkeypatch.setattr(owner, name, act)
        return due

    return make


@pytest.mark.parametrize("output", OUTPUTS)
def test_planner_timers_survive_a_failing_output(output, failing):
    due, robot = failing(PolicyRunner, output), Robot(**SILENT).begin()
    robot.loop.advance_by(5.0)
    due.set()
    robot.sample(speed=0.3)
    assert robot.runner.planner.last.contexts == ("moving",)
    robot.loop.advance_by(60.0)
    assert robot.runner.planner.last.contexts == ()


@pytest.mark.parametrize("agents", [{}, {NODE: CAPABLE}])
@pytest.mark.parametrize("output", OUTPUTS)
def test_all_outputs_of_a_plan_are_eventually_delivered(output, agents, failing):
    due, robot = failing(PolicyRunner, output), Robot()
    robot.session.agents |= agents
    robot.begin()
    robot.loop.advance_by(5.0)
    due.set()
    robot.session.deliver(IMU, speed=0.3)
    robot.loop.advance_by(10.0)
    assert robot.orders.last.shares == {"lab/slam/slam": 800, "lab/speech/speech": 200}
    assert robot.session.plans()[-1]["contexts"] == ["moving"]
    assert are_in_order(stamps(robot))
    assert robot.plans[-1][1] is robot.runner.planner.last
    assert robot.contexts == [("moving", True)]


@pytest.fixture
def unsent(failing):
    """The session can't send what comes next."""
    robot = Robot().begin()
    robot.loop.advance_by(5.0)
    robot.session.published.clear()
    failing(robot.runner.publisher._bus, "publish").set()
    return robot


def test_a_plan_that_could_not_be_sent_is_sent_later(unsent):
    unsent.sample(speed=0.3)
    assert unsent.orders.last.shares == {"lab/slam/slam": 800, "lab/speech/speech": 200}
    assert unsent.session.plans() == []
    unsent.loop.advance_by(RETRY)
    assert [plan["contexts"] for plan in unsent.session.plans()] == [["moving"]]


def test_a_failed_plan_is_sent_later_without_containers(unsent):
    unsent.runner.place(unsent.runner.claim, [])
    unsent.loop.advance_by(10.0)
    assert [plan["targets"] for plan in unsent.session.plans()] == [[]]
