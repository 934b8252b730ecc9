"""Samples from a real Zenoh session to the loop: in order, bounded, and whatever is in them."""

from __future__ import annotations

import itertools
import json
from collections import deque
from dataclasses import replace
from threading import Condition, Event, Thread, current_thread

import pytest
import zenoh
import zenoh.ext
from reactivex.scheduler import VirtualTimeScheduler
from reactivex.testing import TestScheduler

from contextpolicy.loop import Loop
from contextpolicy.planning.inputs import Gone
from contextpolicy.planning.sample import Sample
from contextpolicy.policy.spec import Encoding, Stream
from contextpolicy.streams import subscription
from contextpolicy.streams.attachment import attach
from contextpolicy.streams.decoding import Decoder
from contextpolicy.streams.subscription import BATCH, _Inbox, inputs
from tests.modules.robotkit.bus import Matching
from tests.ports import free_port
from tests.waiting import PATIENCE

IMU = Stream("imu", "robot/imu")
TIMESTAMPING = {"timestamping/enabled": True}
"""As rmw_zenoh has it: what a publisher keeps for late listeners is in order by these."""
MIC = Stream("mic", "robot/microphone")


def open_session(**settings):
    config = zenoh.Config()
    for key, value in {"mode": "peer", "scouting/multicast/enabled": False, **settings}.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


@pytest.fixture(scope="module")
def robot_and_operator():
    """Two sessions, joined by TCP on the loopback; each test has keys of its own on them."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with (
        open_session(**{"listen/endpoints": [endpoint]}) as operator,
        open_session(
            **{"connect/endpoints": [endpoint], "listen/endpoints": [], "timestamping/enabled": True}
        ) as robot,
    ):
        yield robot, operator


class Heard:
    """What arrives, and on which thread; `wait_for` is bounded."""

    def __init__(self):
        self.inputs, self.drops, self.threads = [], [], set()
        self._news = Condition()

    def on_next(self, event):
        with self._news:
            self.inputs.append(event)
            self.threads.add(current_thread().name)
            self._news.notify_all()

    def on_drop(self, stream, reason):
        with self._news:
            self.drops.append((stream, reason))
            self.threads.add(current_thread().name)
            self._news.notify_all()

    def wait_for(self, condition):
        with self._news:
            assert self._news.wait_for(lambda: condition(self), PATIENCE), (self.inputs[-3:], self.drops[-3:])

    def values(self, stream="imu"):
        return [event.value for event in self.inputs if isinstance(event, Sample) and event.stream == stream]


@pytest.fixture
def loop():
    running = Loop()
    yield running
    running.dispose()


@pytest.fixture
def listen(robot_and_operator, loop):
    """Subscribe to streams; returns what is heard."""
    subscriptions = []

    def start(*streams):
        heard = Heard()
        source = inputs(robot_and_operator[1], streams, loop, heard.on_drop)
        subscriptions.append(source.subscribe(heard.on_next))
        return heard

    yield start
    for started in subscriptions:
        started.dispose()


@pytest.fixture
def imu(request):
    return replace(IMU, key=f"{abs(hash(request.node.name))}/imu")


@pytest.fixture
def mic(request):
    base = abs(hash(request.node.name))
    return replace(MIC, key=f"{base}/*/level", liveliness=f"{base}/mic/alive")


@pytest.fixture
def publish(robot_and_operator):
    robot, _ = robot_and_operator

    def put(key, *payloads):
        publisher = robot.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
        Matching(publisher).wait(expected=True)
        for payload in payloads:
            publisher.put(payload)
        publisher.undeclare()

    return put


def test_samples_arrive_in_order_on_the_loops_thread(listen, publish, imu):
    heard = listen(imu)
    publish(imu.key, *(json.dumps({"n": n}) for n in range(500)))
    heard.wait_for(lambda h: len(h.inputs) == 500)
    assert heard.values() == [{"n": n} for n in range(500)]
    assert heard.threads == {"loop"}


def test_each_sample_carries_the_time_of_its_arrival(monkeypatch):
    """Not that at which the loop gets to it."""
    clock = iter([5.0, 6.0])
    monkeypatch.setattr(subscription.time, "monotonic", lambda: next(clock))
    scheduler, heard = TestScheduler(), Heard()
    inbox = an_inbox(scheduler, heard)
    for number in range(2):
        inbox.put(Decoder(IMU), b'{"n": %d}' % number)
    scheduler.advance_by(1)
    assert heard.inputs == [Sample("imu", {"n": 0}, arrived=5.0), Sample("imu", {"n": 1}, arrived=6.0)]


def test_a_key_expression_may_join_several_publishers(listen, publish, mic):
    heard = listen(mic)
    publish(mic.key.replace("*", "left"), '{"level": 1}')
    publish(mic.key.replace("*", "right"), '{"level": 2}')
    heard.wait_for(lambda h: len(h.inputs) == 2)
    assert heard.values("mic") == [{"level": 1}, {"level": 2}]


@pytest.mark.parametrize("broken", [b"", b"{", b"\xff\xfe", b"[" * 100_000, b'{"n": NaN}'])
def test_a_payload_that_cannot_be_decoded_is_counted_and_ends_nothing(listen, publish, imu, broken):
    heard = listen(imu)
    publish(imu.key, '{"n": 1}', broken, '{"n": 2}')
    heard.wait_for(lambda h: len(h.inputs) == 2)
    assert heard.values() == [{"n": 1}, {"n": 2}]
    assert heard.drops == [("imu", "undecodable")]


def test_a_deletion_is_no_sample(listen, robot_and_operator, publish, imu):
    heard = listen(imu)
    publish(imu.key, '{"n": 1}')
    robot_and_operator[0].delete(imu.key)
    publish(imu.key, '{"n": 2}')
    heard.wait_for(lambda h: len(h.values()) == 2)
    assert (heard.values(), heard.drops) == ([{"n": 1}, {"n": 2}], [])


def test_a_sender_that_dies_is_gone(listen, robot_and_operator, mic):
    robot, operator = robot_and_operator
    token = robot.liveliness().declare_token(mic.liveliness)
    seen = Event()
    watcher = operator.liveliness().declare_subscriber(mic.liveliness, lambda _: seen.set(), history=True)
    assert seen.wait(PATIENCE)
    heard = listen(mic)
    token.undeclare()
    heard.wait_for(lambda h: h.inputs)
    watcher.undeclare()
    assert heard.inputs == [Gone("mic")]
    assert heard.threads == {"loop"}


@pytest.fixture
def mission(request):
    return Stream("mission", f"{abs(hash(request.node.name))}/mission/*", Encoding.CDR, type="std_msgs/msg/Int32")


def latched(robot, mission):
    """A publisher as rmw_zenoh makes one for a transient_local topic."""
    key, cache = mission.key.replace("*", "hash"), zenoh.ext.CacheConfig(max_samples=1)
    return zenoh.ext.declare_advanced_publisher(robot, key, cache=cache, publisher_detection=True)


def int32(number):
    return b"\0\1\0\0" + number.to_bytes(4, "little")


@pytest.mark.parametrize("late", [True, False])
def test_a_latched_topic_reaches_whoever_listens_whenever(listen, robot_and_operator, mission, late):
    heard = None if late else listen(mission)
    publisher = latched(robot_and_operator[0], mission)
    publisher.put(int32(1))
    publisher.put(int32(7))
    heard = heard or listen(mission)
    heard.wait_for(lambda h: {"data": 7} in h.values("mission"))
    publisher.put(int32(8))
    heard.wait_for(lambda h: h.values("mission")[-1:] == [{"data": 8}])
    publisher.undeclare()
    assert heard.values("mission")[-2:] == [{"data": 7}, {"data": 8}]


def test_a_type_without_a_header_has_the_time_of_its_publication(listen, robot_and_operator, mission):
    heard = listen(mission)
    key = mission.key.replace("*", "hash")
    publisher = robot_and_operator[0].declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
    Matching(publisher).wait(expected=True)
    publisher.put(int32(1), attachment=attach(1, 1_763_712_350_250_000_000, b"g" * 16))
    publisher.put(int32(2), attachment=b"somebody else's")
    publisher.put(int32(3))
    heard.wait_for(lambda h: len(h.inputs) == 3)
    publisher.undeclare()
    stamps = [sample.timestamp for sample in heard.inputs]
    assert stamps == [pytest.approx(1763712350.25, abs=1.0), None, None]


def test_after_the_end_of_the_subscription_nothing_arrives(robot_and_operator, loop, publish, imu, mic):
    _, operator = robot_and_operator
    ended, other = Heard(), Heard()
    # First, so that the robot always knows of one: else it may look just when the ended one is gone.
    lasting = inputs(operator, [imu], loop, other.on_drop).subscribe(other.on_next)
    inputs(operator, [imu, mic], loop, ended.on_drop).subscribe(ended.on_next).dispose()
    publish(imu.key, "{}")
    other.wait_for(lambda h: h.inputs)
    lasting.dispose()
    assert ended.inputs == []


# between Zenoh's threads and the loop


def an_inbox(scheduler, heard):
    return _Inbox(heard, scheduler, heard.on_drop)


def test_beyond_the_backlog_the_oldest_are_dropped_and_counted(monkeypatch):
    monkeypatch.setattr(subscription, "BACKLOG", 10)
    scheduler, heard = TestScheduler(), Heard()
    inbox, imu, mic = an_inbox(scheduler, heard), Decoder(IMU), Decoder(MIC)
    inbox.put(mic, b'{"level": 1}')
    for n in range(24):
        inbox.put(imu, b'{"n": %d}' % n)
    scheduler.advance_by(1)
    assert heard.values() == [{"n": n} for n in range(14, 24)]
    assert sorted(heard.drops) == [("imu", "overrun")] * 14 + [("mic", "overrun")]


def test_an_inbox_that_the_loop_empties_before_the_oldest_is_dropped_drops_none(monkeypatch):
    monkeypatch.setattr(subscription, "BACKLOG", 0)
    scheduler, heard = TestScheduler(), Heard()
    an_inbox(scheduler, heard).put(Decoder(IMU), b"{}")
    scheduler.advance_by(1)
    assert (len(heard.inputs), heard.drops) == (1, [])


def test_a_storm_leaves_others_their_turn():
    """A new sample for each that is taken: timers and finished patches still act."""
    scheduler, heard = TestScheduler(), Heard()
    inbox, decoder, others = an_inbox(scheduler, heard), Decoder(IMU), []
    put_again = heard.on_next

    def on_next(event):
        put_again(event)
        if not others:
            inbox.put(decoder, b"{}")

    heard.on_next = on_next
    inbox.put(decoder, b"{}")
    scheduler.schedule(lambda *_: others.append("a patch"))
    scheduler.advance_by(1)
    assert others == ["a patch"]
    assert len(heard.inputs) == 2


def test_a_backlog_leaves_others_their_turn_after_each_batch():
    scheduler, heard, turns = TestScheduler(), Heard(), []
    inbox, decoder = an_inbox(scheduler, heard), Decoder(IMU)
    for n in range(2 * BATCH + 1):
        inbox.put(decoder, b'{"n": %d}' % n)
    for _ in range(2):
        scheduler.schedule(lambda *_: turns.append(len(heard.inputs)))
    scheduler.advance_by(1)
    assert turns == [BATCH, BATCH]
    assert heard.values() == [{"n": n} for n in range(2 * BATCH + 1)]


def test_a_sample_that_comes_while_the_loop_falls_asleep_wakes_it_once():
    scheduler, heard = TestScheduler(), Heard()
    inbox, decoder = an_inbox(scheduler, heard), Decoder(IMU)

    class Waiting(deque):
        """Empty when it is looked at, and no more just after."""

        def __bool__(self):
            empty = len(self) == 0
            if empty and len(heard.inputs) < 3:
                inbox.put(decoder, b"{}")
            return not empty

    drains = []
    schedule = scheduler.schedule
    scheduler.schedule = lambda action, state=None: drains.append(action) or schedule(action, state)
    inbox._waiting = Waiting()
    inbox.put(decoder, b"{}")
    scheduler.advance_by(1)
    assert len(heard.inputs) == 3
    assert len(drains) == 3


def test_many_threads_that_put_at_once_lose_nothing(loop):
    heard = Heard()
    inbox, decoder = an_inbox(loop, heard), Decoder(IMU)
    senders = [Thread(target=lambda: [inbox.put(decoder, b"{}") for _ in range(1000)]) for _ in range(3)]
    for sender in senders:
        sender.start()
    heard.wait_for(lambda h: len(h.inputs) == 3000)


@pytest.fixture
def stamped(monkeypatch):
    """What the planner gets of a timestamp of 17.0 where looks at the wall clock show these; the loop's stands at 0."""
    scheduler, heard = VirtualTimeScheduler(), Heard()
    inbox, decoder = an_inbox(scheduler, heard), Decoder(replace(IMU, timestamp="stamp"))

    def stamped(*readings):
        shown = itertools.cycle(readings)
        with monkeypatch.context() as patch:
            patch.setattr(subscription.time, "time", lambda: next(shown))
            inbox.put(decoder, b'{"stamp": 17.0}')
            scheduler.start()
        return heard.inputs[-1].timestamp

    return stamped


@pytest.mark.parametrize("set_to", [0.0, 1000.0])
def test_equal_timestamps_stay_equal(stamped, set_to):
    """They are judged by their order, and a simulation's clock may stand still."""
    first = stamped(set_to)
    assert {stamped(set_to + noise) for noise in (4e-6, -3e-6, 1e-3, -1e-3)} == {first}


def test_a_wall_clock_that_is_set_shifts_timestamps(stamped):
    assert [stamped(wall) for wall in (0.0, 60.0, 60.0, 0.0)] == [17.0, -43.0, -43.0, 17.0]


def test_an_interruption_between_two_looks_at_the_clocks_sets_no_clock(stamped):
    assert [stamped(0.1, 0.0), stamped(0.0)] == [17.0, 17.0]


def test_a_batch_keeps_the_order_across_streams_and_ends(monkeypatch):
    clock = iter(range(100))
    monkeypatch.setattr(subscription.time, "monotonic", lambda: float(next(clock)))
    scheduler, heard = TestScheduler(), Heard()
    inbox, imu, mic = an_inbox(scheduler, heard), Decoder(IMU), Decoder(MIC)
    inbox.put(mic, b'{"level": 1}')
    inbox.put(imu, b'{"n": 1}')
    inbox.put_gone("mic")
    inbox.put(imu, b'{"n": 2}')
    inbox.put(mic, b'{"level": 2}')
    scheduler.advance_by(1)
    told = [event if isinstance(event, Gone) else (event.stream, event.arrived) for event in heard.inputs]
    assert told == [("mic", 0.0), ("imu", 1.0), Gone("mic"), ("imu", 2.0), ("mic", 3.0)]


def test_the_loop_is_woken_once_for_all_that_wait():
    scheduler, heard = TestScheduler(), Heard()
    inbox, decoder = an_inbox(scheduler, heard), Decoder(IMU)
    for _ in range(50):
        inbox.put(decoder, b"{}")
    assert len(scheduler._queue) == 1
    scheduler.advance_by(1)
    assert len(heard.inputs) == 50
    inbox.put(decoder, b"{}")
    assert len(scheduler._queue) == 1


def test_a_reader_that_fails_does_not_end_the_stream():
    scheduler, heard = TestScheduler(), Heard()
    inbox, decoder = an_inbox(scheduler, heard), Decoder(IMU)
    take = heard.on_next

    def fail_once(_):
        heard.on_next = take
        raise RuntimeError("by accident")

    heard.on_next = fail_once
    inbox.put(decoder, b'{"n": 1}')
    inbox.put(decoder, b'{"n": 2}')
    with pytest.raises(RuntimeError):
        scheduler.advance_by(1)
    scheduler.stop()
    scheduler.advance_by(1)
    assert heard.values() == [{"n": 2}]


def test_many_threads_may_put_at_once(loop):
    heard = Heard()
    inbox = an_inbox(loop, heard)
    decoders = [Decoder(replace(IMU, name=f"imu{n}", encoding=Encoding.JSON)) for n in range(8)]

    def put_all(decoder):
        for n in range(500):
            inbox.put(decoder, b'{"n": %d}' % n)

    threads = [Thread(target=put_all, args=(decoder,)) for decoder in decoders]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE)
    heard.wait_for(lambda h: len(h.inputs) == 4000)
    for n in range(8):
        assert heard.values(f"imu{n}") == [{"n": n} for n in range(500)]
