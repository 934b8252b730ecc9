from __future__ import annotations

import json
import queue
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import pytest

from modules.robotkit.inputs import stamp_attachment
from modules.robotkit.message import MessageError
from modules.robotkit.task import Runner, Task
from tests.modules.robotkit.bus import PATIENCE_S, Matching, client, router
from tests.modules.robotkit.test_plan import KEY, a_plan

TASK = Task("echo", "test/in", "test/out", depth=5)


def echo(received):
    if received.payload == b"bad":
        raise MessageError("bad")
    if received.payload == b"fatal":
        raise RuntimeError("fatal")
    return {"heard": received.payload.decode()}


class World:
    """A sensor, a listener and a policy around one running task."""

    def __init__(self, session):
        self.session = session
        self.results = queue.Queue()
        self.adapted = queue.Queue()
        self.sensor = session.declare_publisher(TASK.input)
        self.matching = Matching(self.sensor)
        self.policy = session.declare_publisher(KEY)
        session.declare_subscriber(TASK.output, lambda sample: self.results.put(json.loads(sample.payload.to_bytes())))

    def say(self, payload):
        self.sensor.put(payload, attachment=stamp_attachment(5))

    def next_result(self):
        return self.results.get(timeout=PATIENCE_S)


@contextmanager
def a_running_task():
    stop = threading.Event()
    with router() as address, client(address) as outside, client(address) as inside, ThreadPoolExecutor(1) as pool:
        world = World(outside)
        runner = Runner(inside, TASK, echo, world.adapted.put)
        world.running = pool.submit(runner.run, stop, policy_task="echo")
        try:
            world.matching.wait(expected=True)
            yield world
        finally:
            stop.set()


def test_a_result_carries_its_times():
    with a_running_task() as world:
        world.say(b"hello")
        result = world.next_result()
    timing = result.pop("timing")
    assert result == {"heard": "hello"}
    assert timing["stamp"] == 5
    assert 5 < timing["received"] <= timing["started"] <= timing["finished"]
    assert timing["dropped"] == 0


def test_a_bad_sample_does_not_end_the_module():
    with a_running_task() as world:
        world.say(b"bad")
        world.say(b"good")
        assert world.next_result()["heard"] == "good"


def test_any_other_failure_ends_the_module_loudly():
    with a_running_task() as world:
        world.say(b"fatal")
        with pytest.raises(RuntimeError, match="fatal"):
            world.running.result(PATIENCE_S)


def test_a_suspended_task_takes_no_input_until_it_is_resumed():
    with a_running_task() as world:
        Matching(world.policy).wait(expected=True)
        world.policy.put(a_plan(sequence=1, task="echo", suspended=True))
        world.matching.wait(expected=False)
        assert world.adapted.get(timeout=PATIENCE_S).suspended
        world.policy.put(a_plan(sequence=2, task="echo", share=0.3))
        world.matching.wait(expected=True)
        assert world.adapted.get(timeout=PATIENCE_S).share == 0.3
        world.say(b"awake")
        assert world.next_result()["heard"] == "awake"


def test_a_running_task_is_alive_on_the_bus():
    with a_running_task() as world:
        alive = [str(reply.ok.key_expr) for reply in world.session.liveliness().get("robot/*/alive")]
    assert alive == ["robot/echo/alive"]
