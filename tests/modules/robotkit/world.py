"""A bus with one running task on it: an echo, or a sensor, with sensors, a listener and a policy around it."""

from __future__ import annotations

import json
import queue
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest

from robotkit import Input, MessageError, Module, Needs, Output, Result, Task
from robotkit.runner import Runner
from robotkit.stamps import attachment
from tests.modules.robotkit.bus import Matching, ask, client, router
from tests.modules.robotkit.test_plan import KEY, a_plan
from tests.waiting import PATIENCE

if TYPE_CHECKING:
    from robotkit.plan import Decision

ECHO = Module(
    "echo",
    inputs={"words": Input("test/words", depth=5), "numbers": Input("test/numbers", depth=5)},
    outputs={"heard": Output("test/heard"), "raw": Output("test/raw", encoding="bytes")},
    needs=Needs(deadline=10),
)
SENSOR = Module("sensor", outputs={"reading": Output("test/reading")})


class Echo(Task):
    def __init__(self):
        self.adapted: queue.Queue[Decision] = queue.Queue()
        self.closed = False

    def process(self, received):
        if received.payload == b"bad":
            raise MessageError("bad")
        if received.payload == b"fatal":
            raise RuntimeError("fatal")
        if received.input == "numbers":
            return [Result("heard", {"number": float(received.payload)}), Result("raw", received.payload, stamp=9)]
        return [Result("heard", {"heard": received.payload.decode()})]

    def adapt(self, decision):
        self.adapted.put(decision)

    def close(self):
        self.closed = True


class Sensor(Task):
    """Produces until it has to end; what it reads from fails after one reading, as often as there are failures."""

    def __init__(self, *failures):
        self.opened = 0
        self.released: queue.Queue[int] = queue.Queue()
        self.failures = failures

    def produce(self, ended):
        self.opened += 1
        try:
            yield Result("reading", {"value": self.opened}, stamp=7)
            if self.opened <= len(self.failures):
                raise self.failures[self.opened - 1]
            ended.wait(PATIENCE)
        finally:
            self.released.put(self.opened)


class World:
    """Sensors, a listener and a policy around one running task; `running` is its run."""

    running: Future[None]

    def __init__(self, session, module, address, stop):
        self.session, self.address, self.stop = session, address, stop.set
        self.results: dict[str, queue.Queue[bytes]] = {name: queue.Queue() for name in module.outputs}
        self.sensors = {name: session.declare_publisher(entry.key) for name, entry in module.inputs.items()}
        self.matching = {name: Matching(sensor) for name, sensor in self.sensors.items()}
        self.policy = session.declare_publisher(KEY)
        for name, output in module.outputs.items():
            session.declare_subscriber(output.key, self.listener(name))

    def listener(self, name):
        return lambda sample: self.results[name].put(sample.payload.to_bytes())

    def say(self, payload, to="words"):
        self.sensors[to].put(payload, attachment=attachment(5))

    def wait_for_inputs(self, *, expected):
        for matching in self.matching.values():
            matching.wait(expected=expected)

    def decide(self, **plan):
        Matching(self.policy).wait(expected=True)
        self.policy.put(a_plan(**plan))

    def suspend_and_resume(self, task):
        """An `Echo` adapts to both plans, and takes inputs only under the second."""
        self.decide(sequence=1, task="echo", suspended=True)
        self.wait_for_inputs(expected=False)
        assert task.adapted.get(timeout=PATIENCE).suspended
        self.decide(sequence=2, task="echo", share=0.3)
        self.wait_for_inputs(expected=True)
        assert task.adapted.get(timeout=PATIENCE).share == 0.3

    def ask(self, key):
        """The answer, as soon as the router knows who gives it."""
        return json.loads(ask(self.session, key)[0])

    def next_raw(self, name):
        return self.results[name].get(timeout=PATIENCE)

    def next_result(self):
        return json.loads(self.next_raw(next(iter(self.results))), parse_constant=pytest.fail)


@contextmanager
def running(module, task, **options):
    stop = threading.Event()
    with router() as address, client(address) as outside, client(address) as inside, ThreadPoolExecutor(1) as pool:
        world = World(outside, module, address, stop)
        for output in module.outputs.values():  # a task without inputs begins at once
            with inside.declare_publisher(output.key) as publisher:
                Matching(publisher).wait(expected=True)
        world.running = pool.submit(Runner(inside, module, task, shared_memory=False).run, stop, **options)
        try:
            world.wait_for_inputs(expected=True)
            yield world
        finally:
            stop.set()
