"""The agent is killed at every instant of a suspension and a resumption, and stays away while the API goes on.

The API and its kubelet are a value and two writes here: what the kubelet writes while no agent lives, no agent hears.
"""

from __future__ import annotations

import itertools
from datetime import timedelta
from time import monotonic

import pytest
from reactivex.testing import TestScheduler

from contextpolicy.agent.leftovers import undo
from contextpolicy.agent.state_directory import StateDirectory
from tests.agent.builders import POLICY, SLAM, Tree, a_message, a_target, agent_settings, an_agent
from tests.agent.test_crash_points import Fuse, Killed, points

GRACE = 10.0
SUSPENDED = 10
RESUMED = 500
ORIGINALS = [RESUMED, 800, 100, None]
"""Equal to the resumed share, above it, below it, and none at all."""
STEPS = ["plan", "settle", "plan", "settle", "delete"]
"""Suspended, in force through the API too; resumed, the same; the policy is deleted, and the API has the original."""


class Robot:
    """One container, the API's limit of it, and an agent that may be away."""

    def __init__(self, tmp_path, original, version):
        self.tree, self._state = Tree(tmp_path / "cgroup", version), tmp_path / "state"
        self.original = self.api = original
        self.group = self.tree.container(SLAM, limit=original)
        self.wanted, self.sequence, self.deleted = original, 0, False
        self.agent = None
        self.start()

    def start(self):
        self.time = TestScheduler()
        self.agent = an_agent(self.tree, self._state, self.time, grace=GRACE)
        self.agent.start()

    def kill(self):
        self.agent = None

    def step(self, step):
        if step == "plan":
            self.sequence += 1
            self.wanted = SUSPENDED if self.sequence == 1 else RESUMED
            self.publish()
        elif step == "settle":
            self.resize(self.wanted)
        else:
            self.deleted = True
            self.resize(self.original)
            if self.agent is not None:
                self.agent.hear(POLICY, None)

    def publish(self):
        """What the operator publishes: also the original, and the limit that the kubelet reports."""
        if self.agent is not None:
            self.agent.find_source(POLICY)
            original = None if self.original is None else self.original / 1000
            limit = None if self.api is None else self.api / 1000
            held = self.original is None
            target = a_target(SLAM, self.wanted / 1000, original=original, limit=limit, held=held)
            self.agent.hear(POLICY, a_message(target, sequence=self.sequence))

    def resize(self, limit):
        """The API takes it, if it is one that it can have; the kubelet writes the pod and the container."""
        if self.original is None or limit == self.api:
            return
        rises = limit > self.api
        self.api = limit
        for group in (self.group.parent, self.group) if rises else (self.group, self.group.parent):
            if self.tree.limit(group) == limit and group == self.group.parent:
                continue  # it does not rewrite a pod limit that is right already
            with self.tree.limit_file(group).open("w") as file:
                file.write(f"{limit * 100}\n" if self.tree.version == 1 else f"{limit * 100} 100000\n")
            if self.agent is not None:
                self.agent.on_other_write(self.tree.limit_file(group), monotonic())

    def wait(self):
        self.time.advance_by(timedelta(seconds=2 * GRACE))

    def supervise(self):
        undo(agent_settings(self.tree.mount, self._state))

    @property
    def anything_left(self):
        return StateDirectory(self._state).anything_left

    @property
    def limit(self):
        return self.tree.limit(self.group)

    @property
    def is_undone(self):
        """A pod may keep more than it needs: that limits nobody, and the kubelet's next write corrects it."""
        pod = self.tree.limit(self.group.parent)
        fits = pod is None or (self.limit is not None and pod >= self.limit)
        return fits and self.limit == self.original


@pytest.fixture(params=list(itertools.product(ORIGINALS, (1, 2))), ids=str)
def robot(request, tmp_path):
    return Robot(tmp_path, *request.param)


def live_and_die(robot, last, back):
    """The agent is killed after the step `last`, and away until the step `back`."""
    for number, step in enumerate(STEPS[: back + 1]):
        robot.step(step)
        if number == last:
            robot.kill()


POINTS = [(last, back) for last in range(len(STEPS)) for back in range(last, len(STEPS))]
OVERTAKEN = [(0, 3), (1, 3)]
"""The kubelet wrote a limit that the killed agent never knew: that is the API's, which the operator puts back."""
UNDOING = [point for point in POINTS if point not in OVERTAKEN]


@pytest.mark.parametrize(("last", "back"), OVERTAKEN)
def test_kubelet_writes_after_the_agents_death_are_kept(robot, last, back):
    live_and_die(robot, last, back)
    robot.supervise()
    assert robot.limit == (RESUMED if robot.original is not None else None)
    assert not robot.anything_left


@pytest.mark.parametrize(("last", "back"), UNDOING)
def test_supervisor_restores_the_original(robot, last, back):
    live_and_die(robot, last, back)
    robot.supervise()
    assert robot.is_undone
    assert not robot.anything_left, "the supervisor would be started again and again"


@pytest.mark.parametrize(("last", "back"), [point for point in POINTS if point[1] < len(STEPS) - 1])
def test_the_next_agent_continues_with_the_plan_and_can_undo_it(robot, last, back):
    live_and_die(robot, last, back)
    robot.start()
    robot.publish()
    assert robot.limit == robot.wanted
    robot.step("delete")
    assert robot.is_undone


@pytest.mark.parametrize("last", range(len(STEPS)))
def test_a_stopped_agent_leaves_what_the_api_has_while_an_operator_plans(robot, last):
    live_and_die(robot, len(STEPS), last)
    robot.agent.stop()
    assert robot.limit == robot.api
    assert not robot.anything_left


@pytest.mark.parametrize("last", range(len(STEPS)))
def test_a_stopped_agent_restores_originals_without_an_operator(robot, last):
    live_and_die(robot, len(STEPS), last)
    robot.agent.lose_source(POLICY)
    robot.agent.stop()
    assert robot.is_undone


WRITES, LINES = 8, 3
"""No story has more, and some have as many."""


@pytest.mark.parametrize("deleted", [False, True], ids=["alive", "deleted"])
@pytest.mark.parametrize(("write", "moment"), points(WRITES, LINES))
def test_agent_killed_at_any_write_undoes_unconfirmed_limits(robot, monkeypatch, write, moment, deleted):
    fuse = Fuse(monkeypatch)
    fuse.left, fuse.moment = write, moment
    for step in STEPS if deleted else STEPS[:-1]:
        try:
            robot.step(step)
        except Killed:
            robot.kill()
    fuse.left = None
    assert fuse.writes <= WRITES
    assert fuse.lines <= LINES
    if robot.agent is not None and deleted:
        assert robot.is_undone
        return
    robot.start()
    robot.wait()
    assert robot.limit in (robot.original, robot.api)
    assert robot.is_undone or not deleted
    robot.supervise()
    assert not robot.anything_left
