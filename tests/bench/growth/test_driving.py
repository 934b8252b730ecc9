"""What the curves are about: every turn moves every limit, and a sample of the IMU none."""

from time import time

import pytest

from contextpolicy.planning.allocation.placement import Container, Placement
from contextpolicy.planning.planner import Planner
from contextpolicy.policy import parsing
from contextpolicy.streams.decoding import Decoder
from tests.bench.fleet.crowd import Fleet
from tests.bench.growth.driving import Driving
from tests.bench.growth.sweeps import SWEEPS, TASKS, fleet_of
from tests.bench.live_case import steady
from tests.planning.quiet import Quiet

ROBOT, NODE = "robot-000", "node-000"


class Robot:
    """The first robot of a fleet, on its node of 8 cores."""

    def __init__(self, fleet: Fleet):
        policy = parsing.parse(fleet.policy(ROBOT))
        self.decoders = {stream.name: Decoder(stream) for stream in policy.streams}
        self.planner, self.now = Planner(policy, Quiet(), {}), time()
        self.planner.start(self.now)
        names = [(f"task-{task}", replica) for task in range(fleet.tasks) for replica in range(fleet.replicas)]
        containers = tuple(Container(f"{task}-{replica}", task, NODE, 10) for task, replica in names)
        self.planner.handle(Placement({NODE: 8000}, containers), self.now)

    def hear(self, stream, payload):
        """The shares of the new plans."""
        self.now += 0.5
        plans = self.planner.handle(self.decoders[stream].decode(payload), self.now)
        return [plan.nodes[NODE].containers for plan in plans]

    def turn(self, left):
        return self.hear("turn", b'{"left": true}' if left else b'{"left": false}')


@pytest.mark.parametrize("containers", SWEEPS["containers"])
def test_each_turn_changes_every_limit(containers):
    fleet = fleet_of(containers)
    robot = Robot(fleet)
    assert robot.planner.last is not None
    before = robot.planner.last.nodes[NODE].containers
    assert len(before) == containers == fleet.limits
    for left in (True, False, True):
        [now] = robot.turn(left)
        assert [name for name in now if now[name] == before[name]] == []
        before = now


def test_imu_samples_alone_make_no_plan():
    robot = Robot(Driving(1, TASKS, pods=TASKS))
    robot.hear("imu", steady(0))
    *_, before = robot.turn(left=False)  # the context that the IMU begins comes first
    for left in (True, False):
        assert [plans for number in range(20) if (plans := robot.hear("imu", steady(number)))] == []
        [now] = robot.turn(left)
        assert [name for name in now if now[name] == before[name]] == []
        before = now
