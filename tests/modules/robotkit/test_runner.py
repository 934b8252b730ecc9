from __future__ import annotations

import json
import math
import queue
import threading

import pytest

from robotkit import Input, Module, Needs, Output, Task, ros
from robotkit.inputs import Inputs
from robotkit.outputs import as_results
from robotkit.runner import Runner
from tests.modules.robotkit.bus import Matching, client, router
from tests.modules.robotkit.world import ECHO, SENSOR, Echo, Sensor, running
from tests.waiting import PATIENCE, until

STAMP = 1_795_300_000_123_456_789
WATCHER = Module("watcher", inputs={"words": Input("test/words", depth=1000)})


class Watcher(Task):
    """Has nothing to say."""

    def process(self, received):
        del received


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


def test_a_task_that_keeps_its_runs_answers_with_all_of_them_even_without_results():
    """Asked twice it says all again: a bus that is short of CPU has lost none."""
    with running(WATCHER, Watcher(), keep_runs=True) as world:
        for _ in range(3):
            world.say(b"nothing to say")
        until(lambda: len(kept(world)) == 3)
        timings = kept(world)
    timing = timings[0]
    assert len(timings) == 3
    assert (timing["input"], timing["stamp"], timing["missed"]) == ("words", 5, False)
    assert timing["received"] <= timing["started"] <= timing["finished"]


def kept(world):
    (reply,) = world.session.get("robot/*/runs", timeout=PATIENCE)
    return json.loads(reply.ok.payload.to_bytes())


def test_one_sample_may_lead_to_several_results():
    with running(ECHO, Echo()) as world:
        world.say(b"0.5", to="numbers")
        assert world.next_result()["number"] == 0.5
        assert world.next_raw("raw") == b"0.5"


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_nan_is_encoded_as_null(value):
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


POINT, TEXT = "geometry_msgs/msg/PointStamped", "std_msgs/msg/String"


@pytest.mark.parametrize(
    ("type_name", "fields", "stamp"), [(POINT, {}, STAMP), (TEXT, {"data": "a word, not a stamp"}, 5)]
)
def test_a_result_of_a_ros_message_has_its_headers_stamp(type_name, fields, stamp):
    """By that ROS, and the sidecar, match an answer to its input; the timing has when it was published."""

    class Answer(Task):
        def process(self, received):
            return {"length": len(received.payload)}

    module = Module("answer", inputs={"words": Input("test/words", "cdr", type_name)}, outputs={"x": Output("test/x")})
    with running(module, Answer()) as world:
        world.say(ros.encode(fields, type_name, stamp=STAMP))
        result = world.next_result()
    assert (result["stamp"], result["timing"]["stamp"]) == (stamp, 5)


def test_a_mapping_for_several_outputs_is_a_bug_of_the_module():
    with pytest.raises(TypeError, match=r"this one has .'heard', 'raw'.: return Results"):
        as_results({"x": 1}, ECHO.outputs)


def test_a_suspended_task_takes_no_input_until_it_is_resumed():
    task = Echo()
    with running(ECHO, task) as world:
        world.suspend_and_resume(task)
        world.say(b"awake")
        assert world.next_result()["heard"] == "awake"


def test_a_task_adapts_to_its_suspension_when_its_device_is_free():
    order: list[str] = []

    class Ordered(Sensor):
        def produce(self, ended):
            yield from super().produce(ended)
            order.append("released")

        def adapt(self, decision):
            order.append("adapted" if decision.suspended else "resumed")
            self.released.put(0)

    task = Ordered()
    with running(SENSOR, task) as world:
        world.next_result()
        world.decide(sequence=1, task="sensor", suspended=True)
        assert [task.released.get(timeout=PATIENCE) for _ in range(2)] == [1, 0]
    assert order[:2] == ["released", "adapted"]


def test_a_running_task_is_alive_on_the_bus():
    with running(ECHO, Echo()) as world:
        alive = [str(reply.ok.key_expr) for reply in world.session.liveliness().get("robot/*/alive")]
    assert alive == ["robot/echo/alive"]


def test_the_profile_can_be_queried():
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


class Slow(Task):
    """Takes as long as its quality says, and notes it."""

    def __init__(self):
        self.qualities: queue.Queue[float] = queue.Queue()

    def process(self, received):
        del received
        threading.Event().wait(0.02)
        return {"value": 1}

    def set_quality(self, quality):
        self.qualities.put(quality)


SLOW = Module(
    "slow", inputs={"words": Input("test/words")}, outputs={"x": Output("test/x")}, needs=Needs(deadline=0.001)
)


def test_a_late_task_gets_a_lower_quality():
    task = Slow()
    with running(SLOW, task) as world:
        world.say(b"a")
        world.results["x"].get(timeout=PATIENCE)
        world.say(b"b")
        assert task.qualities.get(timeout=PATIENCE) < 1


@pytest.mark.parametrize(("task", "adaptive"), [(Slow(), False), (Echo(), True)])
def test_quality_is_fixed_if_disabled_or_unsupported(task, adaptive):
    with router() as address, client(address) as session:
        assert not Runner(session, SLOW, task, shared_memory=False, adaptive=adaptive)._quality.adaptive
