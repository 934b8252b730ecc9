"""A restarted operator leaves alone what it can't know yet, and decides everything else at once."""

from __future__ import annotations

import pytest

from contextpolicy.planning.conditions.sample import Sample
from contextpolicy.planning.inputs import Gone
from contextpolicy.planning.planner import Planner
from contextpolicy.planning.restart import Remembered
from tests.planning.builders import START, a_context, a_parent, a_policy, a_stream, a_task, on_node
from tests.planning.quiet import Quiet

SUSPENDED, HEAVY = Remembered(0.0, suspended=True), Remembered(7.0, suspended=False)
STREAMS = [a_stream("imu", staleAfter="10s"), a_stream("btn"), a_stream("mic")]


class Restarted:
    """A planner that starts with what another left."""

    def __init__(self, remembered, **spec):
        self.policy = a_policy(**{"streams": STREAMS, **spec})
        self.planner = Planner(self.policy, Quiet(), remembered)
        self.planner.start(START)
        self.planner.handle(on_node(*(task.name for task in self.policy.leaves)), START)

    def sample(self, stream, at, **value):
        self.planner.handle(Sample(stream, value), START + at)

    def weights(self, at):
        self.planner.advance(START + at)
        assert self.planner.last is not None
        return {name: task.weight for name, task in self.planner.last.tasks.items()}


READERS = {
    "an activity": {"tasks": [a_task("slam", activity=[{"when": "imu.speed > 1"}])]},
    "an activity's stream": {"tasks": [a_task("slam", activity=[{"stream": "imu"}])]},
    "a pre-condition": {"tasks": [a_task("slam", requires=[{"when": "imu.speed > 1"}])]},
    "a context": {
        "tasks": [a_task("slam", idle=0)],
        "contexts": [a_context("fast", "imu.speed > 1", {"slam": {"weight": 2}})],
    },
    "a context's end": {
        "tasks": [a_task("slam", idle=0)],
        "contexts": [a_context("fast", "btn.a", {"slam": {"weight": 2}}, until="imu.speed < 1")],
    },
    "a context of a context": {
        "tasks": [a_task("slam", idle=0)],
        "contexts": [a_context("fast", "imu.speed > 1"), a_context("b", "contexts.fast", {"slam": {"weight": 2}})],
    },
    "its group": {
        "tasks": [a_parent("all", "slam"), a_task("slam", idle=0)],
        "contexts": [a_context("fast", "imu.speed > 1", {"all": {"weight": 2}})],
    },
    "a part of its group": {
        "tasks": [a_parent("all", "slam", "map"), a_task("slam", idle=0), a_task("map", requires=[{"when": "imu.on"}])]
    },
    "a task that it requires": {
        "tasks": [a_task("slam", idle=0, requires=[{"task": "map"}]), a_task("map", requires=[{"when": "imu.on"}])]
    },
    "the fallback": {
        "tasks": [a_task("slam", idle=0)],
        "contexts": [a_context("blind", tasks={"slam": {"weight": 2}})],
        "fallback": "blind",
    },
    "its stream's own fallback": {
        "streams": [a_stream("imu", staleAfter="10s", fallback="blind"), a_stream("btn")],
        "tasks": [a_task("slam", idle=0)],
        "contexts": [a_context("blind", tasks={"slam": {"weight": 2}})],
    },
}


@pytest.mark.parametrize("spec", READERS.values(), ids=READERS.keys())
def test_a_task_that_depends_on_a_stream_not_heard_yet_keeps_its_state(spec):
    robot = Restarted({"slam": HEAVY}, **spec)
    assert robot.weights(0)["slam"] == 7.0
    assert robot.weights(9.9)["slam"] == 7.0
    assert robot.weights(10)["slam"] != 7.0


@pytest.mark.parametrize("spec", READERS.values(), ids=READERS.keys())
def test_hearing_the_stream_ends_the_wait(spec):
    robot = Restarted({"slam": HEAVY}, **spec)
    robot.sample("btn", 0.5, a=False)
    robot.sample("imu", 1, speed=0.0, on=False)
    assert robot.weights(2)["slam"] != 7.0


def test_a_suspended_task_stays_suspended_until_its_stream_is_heard():
    tasks = [a_task("slam"), a_task("rest")]
    contexts = [a_context("fast", "imu.speed > 1", {"slam": {"suspend": True}})]
    robot = Restarted({"slam": SUSPENDED, "rest": HEAVY}, tasks=tasks, contexts=contexts)
    assert robot.weights(9)["slam"] == 0.0
    assert robot.planner.last is not None
    assert robot.planner.last.tasks["slam"].suspended
    assert robot.weights(9)["rest"] == 1.0, "it reads nothing"
    assert robot.weights(10)["slam"] == 1.0


def test_an_infinite_age_has_no_effect_until_the_wait_is_over():
    contexts = [a_context("blind", "age(imu) > 1.0", {"slam": {"suspend": True}})]
    robot = Restarted({"slam": HEAVY}, tasks=[a_task("slam")], contexts=contexts)
    assert robot.weights(9.9)["slam"] == 7.0
    assert robot.weights(10)["slam"] == 0.0


def test_without_stale_after_the_wait_is_two_seconds():
    robot = Restarted({"slam": HEAVY}, tasks=[a_task("slam", activity=[{"when": "btn.pressed"}])])
    assert robot.weights(1.9)["slam"] == 7.0
    assert robot.weights(2.0)["slam"] == 0.0


def test_each_task_waits_for_all_of_its_streams():
    tasks = [a_task("slam", activity=[{"when": "btn.pressed || imu.speed > 1"}])]
    robot = Restarted({"slam": HEAVY}, tasks=tasks)
    assert robot.weights(5)["slam"] == 7.0
    robot.sample("imu", 6, speed=0.0)
    assert robot.weights(6)["slam"] == 0.0


def test_a_lost_token_ends_the_wait():
    robot = Restarted({"slam": HEAVY}, tasks=[a_task("slam", activity=[{"when": "imu.speed > 1"}])])
    robot.planner.handle(Gone("imu"), START + 1)
    assert robot.weights(1)["slam"] == 0.0


def test_the_fallback_starts_no_earlier_than_it_would():
    contexts = [a_context("blind", "age(imu) > 100", {"slam": {"weight": 2}})]
    robot = Restarted({}, tasks=[a_task("slam")], contexts=[*contexts, a_context("lost")], fallback="lost")
    robot.weights(9.9)
    assert [context.spec.name for context in robot.planner.active_contexts()] == ["blind"]
    robot.weights(10)
    assert [context.spec.name for context in robot.planner.active_contexts()] == ["blind", "lost"]


def test_a_forced_context_does_not_wait():
    contexts = [a_context("halt", "imu.halt", {"slam": {"suspend": True}})]
    force = {"context": "halt", "until": "2100-01-01T00:00:00Z"}
    robot = Restarted({"slam": HEAVY}, tasks=[a_task("slam")], contexts=contexts, force=force)
    assert robot.weights(0)["slam"] == 0.0


def test_a_forced_context_reaches_the_parts_of_a_group():
    tasks = [a_parent("all", "slam"), a_task("slam")]
    contexts = [a_context("halt", "imu.halt", {"all": {"suspend": True}})]
    force = {"context": "halt", "until": "2100-01-01T00:00:00Z"}
    robot = Restarted({"slam": HEAVY}, tasks=tasks, contexts=contexts, force=force)
    assert robot.weights(0)["slam"] == 0.0


def test_a_new_policy_has_no_state_to_keep():
    robot = Restarted({}, tasks=[a_task("slam", activity=[{"when": "imu.speed > 1"}])])
    assert robot.weights(0)["slam"] == 0.0


@pytest.mark.parametrize(("stream", "ends"), [("imu", 10.0), ("btn", 2.0)])
def test_an_edit_does_not_end_the_wait(stream, ends):
    tasks = [a_task("slam", activity=[{"when": f"{stream}.speed > 1"}])]
    robot = Restarted({"slam": HEAVY}, tasks=tasks)
    former, robot.planner = robot.planner, Planner(a_policy(streams=STREAMS, tasks=tasks, reserve="10m"), Quiet(), {})
    robot.planner.start(START + 1, former)
    assert robot.weights(ends - 0.1)["slam"] == 7.0
    assert robot.weights(ends)["slam"] == 0.0


def test_a_suspended_task_stays_suspended_while_all_are_idle():
    robot = Restarted({"slam": SUSPENDED}, tasks=[a_task("slam", activity=[{"when": "btn.pressed"}])])
    assert robot.weights(1)["slam"] == 0.0
    assert robot.planner.last is not None
    assert robot.planner.last.tasks["slam"].suspended


def test_an_idle_task_is_not_suspended_by_an_unknown_stream():
    tasks = [a_task("slam", activity=[{"when": "btn.on"}], requires=[{"when": "btn.on"}])]
    robot = Restarted({"slam": Remembered(0.0, suspended=False)}, tasks=tasks)
    assert robot.planner.last is not None
    assert not robot.planner.last.tasks["slam"].suspended
    robot.weights(2)
    assert robot.planner.last.tasks["slam"].suspended


def test_an_edit_does_not_restart_an_expired_wait():
    tasks = [a_task("slam", activity=[{"when": "imu.on || btn.on"}])]
    robot = Restarted({"slam": HEAVY}, tasks=tasks)
    robot.weights(9)
    former, robot.planner = robot.planner, Planner(a_policy(streams=STREAMS, tasks=tasks, reserve="10m"), Quiet(), {})
    robot.planner.start(START + 9, former)
    assert robot.weights(9.9)["slam"] == 7.0
    assert robot.weights(10)["slam"] == 0.0
