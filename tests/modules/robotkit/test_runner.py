from __future__ import annotations

import json
import math
import queue
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest

from robotkit import ConfigurationError, DeviceError, Input, MessageError, Module, Needs, Output, Result, Task, ros
from robotkit import producer as producer_module
from robotkit.inputs import Inputs
from robotkit.outputs import as_results
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
WATCHER = Module("watcher", inputs={"words": Input("test/words", depth=1000)})
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


class Watcher(Task):
    """Has nothing to say."""

    def process(self, received):
        del received


class Sensor(Task):
    """Produces until it is told to end; what it reads from fails after one reading, as often as there are failures."""

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

    def __init__(self, session, module, address):
        self.session, self.address = session, address
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
        world = World(outside, module, address)
        for output in module.outputs.values():  # a task without inputs begins at once
            with inside.declare_publisher(output.key) as publisher:
                Matching(publisher).wait(expected=True)
        world.running = pool.submit(Runner(inside, module, task).run, stop, **options)
        try:
            world.wait_for_inputs(expected=True)
            yield world
        finally:
            stop.set()


def test_a_result_carries_its_times():
    with running(ECHO, Echo()) as world:
        world.say(b"hello")
        result = world.next_result()
    timing = result.pop("timing")
    assert result == {"stamp": 5, "heard": "hello"}
    assert (timing["input"], timing["stamp"], timing["dropped"]) == ("words", 5, 0)
    assert 5 < timing["received"] <= timing["started"] <= timing["finished"]
    assert timing["cpu"] > 0
    assert timing["missed"] is False  # the stamp is no time of this clock, so the arrival counts


def test_runs_are_published_where_asked_for_without_any_result_too():
    runs: queue.Queue[bytes] = queue.Queue()
    with running(WATCHER, Watcher(), publish_runs=True) as world:
        world.session.declare_subscriber("robot/watcher/runs", lambda sample: runs.put(sample.payload.to_bytes()))
        for _ in range(3):
            world.say(b"nothing to tell")
        timings = json.loads(runs.get(timeout=PATIENCE))
        while len(timings) < 3:
            timings += json.loads(runs.get(timeout=PATIENCE))
    timing = timings[0]
    assert (timing["input"], timing["stamp"], timing["missed"]) == ("words", 5, False)
    assert timing["received"] <= timing["started"] <= timing["finished"]


def test_one_sample_may_lead_to_several_results():
    with running(ECHO, Echo()) as world:
        world.say(b"0.5", to="numbers")
        assert world.next_result()["number"] == 0.5
        assert world.next_raw("raw") == b"0.5"


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_json_cannot_say_leaves_as_null(value):
    with running(ECHO, Echo()) as world:
        world.say(str(value).encode(), to="numbers")
        assert world.next_result()["number"] is None


def test_a_result_can_go_out_as_a_ros_message():
    pose = Output("test/pose", "cdr", "geometry_msgs/msg/PointStamped", "map")
    module = Module("point", inputs={"words": Input("test/words")}, outputs={"pose": pose})

    class Point(Task):
        def process(self, received):
            return {"point": [float(received.payload), 0, 0]}

    with running(module, Point()) as world:
        heard = Inputs(world.session, {"pose": Input(pose.key, pose.encoding, pose.type)})
        heard.resume()
        Matching(world.session.declare_publisher(pose.key)).wait(expected=True)
        world.say(b"1.5")
        received = heard.take()
        heard.close()
    assert received is not None
    message = ros.decode(received.payload, received.type)
    assert (message.point.x, message.header.frame_id, ros.stamp_of(message)) == (1.5, "map", 5)
    assert 0 < received.stamp <= received.received  # from the attachment, in rmw_zenoh's form


def test_a_mapping_for_several_outputs_is_a_bug_of_the_module():
    with pytest.raises(TypeError, match=r"this one has .'heard', 'raw'.: give Results"):
        as_results({"x": 1}, ECHO.outputs)


def test_a_failing_source_of_another_kind_ends_the_module_loudly():
    with running(SENSOR, Sensor(RuntimeError("bug"))) as world, pytest.raises(RuntimeError, match="bug"):
        world.running.result(PATIENCE)


def test_a_bad_sample_does_not_end_the_module():
    with running(ECHO, Echo()) as world:
        world.say(b"bad")
        world.say(b"good")
        assert world.next_result()["heard"] == "good"


def test_any_other_failure_ends_the_module_loudly_and_safely():
    task = Echo()
    with running(ECHO, task) as world:
        world.say(b"fatal")
        with pytest.raises(RuntimeError, match="fatal"):
            world.running.result(PATIENCE)
    assert task.closed


def test_a_suspended_task_takes_no_input_until_it_is_resumed():
    task = Echo()
    with running(ECHO, task) as world:
        world.decide(sequence=1, task="echo", suspended=True)
        world.wait_for_inputs(expected=False)
        assert task.adapted.get(timeout=PATIENCE).suspended
        world.decide(sequence=2, task="echo", share=0.3)
        world.wait_for_inputs(expected=True)
        assert task.adapted.get(timeout=PATIENCE).share == 0.3
        world.say(b"awake")
        assert world.next_result()["heard"] == "awake"


def test_a_running_task_is_alive_on_the_bus():
    with running(ECHO, Echo()) as world:
        alive = [str(reply.ok.key_expr) for reply in world.session.liveliness().get("robot/*/alive")]
    assert alive == ["robot/echo/alive"]


def test_the_profile_answers_who_asks():
    with running(ECHO, Echo()) as world:
        for word in (b"one", b"bad", b"two"):
            world.say(word)
        for _ in range(2):
            world.next_result()
        profile = world.ask("robot/echo/profile")
    assert (profile["task"], profile["module"], profile["deadline"]) == ("echo", "echo", 10)
    words = profile["inputs"]["words"]
    assert (words["done"], words["broken"], words["missed"]) == (2, 1, 0)
    assert len(words["cpu"]["quantiles"]) == 21
    assert profile["inputs"]["numbers"]["cpu"] == {"mean": None, "std": None, "quantiles": []}


@pytest.mark.parametrize("failure", [DeviceError("unplugged"), ConfigurationError("row 7 makes no sense")])
def test_a_source_that_fails_is_opened_again_and_freed_while_suspended(failure, monkeypatch):
    monkeypatch.setattr(producer_module, "FIRST_RETRY_S", 0.01)
    task = Sensor(failure)
    with running(SENSOR, task) as world:
        assert [world.next_result() for _ in range(2)] == [{"stamp": 7, "value": 1}, {"stamp": 7, "value": 2}]
        assert task.released.get(timeout=PATIENCE) == 1
        world.decide(sequence=1, task="sensor", suspended=True)
        assert task.released.get(timeout=PATIENCE) == 2, "of two plans in a row only the newer one counts"
        world.decide(sequence=2, task="sensor", share=0.1)
        assert world.next_result()["value"] == 3
