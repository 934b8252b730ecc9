"""Samples from a real Zenoh session to the loop: whatever is in them, from any sender, until the end."""

from __future__ import annotations

import json
from dataclasses import replace
from threading import Event

import pytest
import zenoh
import zenoh.ext

from contextpolicy.bus.session import RETRY
from contextpolicy.planning.conditions.sample import Sample
from contextpolicy.planning.inputs import Gone
from contextpolicy.policy.stream_spec import Encoding, Stream
from contextpolicy.streams.attachment import attach
from contextpolicy.streams.backlog import PER_STREAM, TOTAL, Backlog
from contextpolicy.streams.decoding import MAX_PAYLOAD
from contextpolicy.streams.subscription import LONGEST_KEY, inputs
from tests.modules.robotkit.bus import Matching
from tests.ports import free_port
from tests.streams.heard import IMU, MIC, Heard
from tests.waiting import PATIENCE, until


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


@pytest.fixture
def listen(robot_and_operator, loop):
    """Subscribe to streams; returns what is heard."""
    subscriptions = []

    def start(*streams):
        heard = Heard()
        source = inputs(robot_and_operator[1], streams, loop, heard, backlog=Backlog(PER_STREAM, TOTAL))
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


def test_a_key_expression_may_join_several_publishers(listen, publish, mic):
    heard = listen(mic)
    publish(mic.key.replace("*", "left"), '{"level": 1}')
    publish(mic.key.replace("*", "right"), '{"level": 2}')
    heard.wait_for(lambda h: len(h.inputs) == 2)
    assert heard.values("mic") == [{"level": 1}, {"level": 2}]
    assert [sample.key for sample in heard.inputs] == [mic.key.replace("*", side) for side in ("left", "right")]


@pytest.mark.parametrize("broken", [b"", b"{", b"\xff\xfe", b"[" * 100_000, b'{"n": NaN}'])
def test_a_payload_that_cannot_be_decoded_is_counted_and_ends_nothing(listen, publish, imu, broken):
    heard = listen(imu)
    publish(imu.key, '{"n": 1}', broken, '{"n": 2}')
    heard.wait_for(lambda h: len(h.inputs) == 2)
    assert heard.values() == [{"n": 1}, {"n": 2}]
    assert heard.drops == [("imu", "undecodable")]


def test_a_payload_that_is_too_large_is_counted_before_it_is_kept(listen, publish, imu):
    heard = listen(imu)
    publish(imu.key, '{"n": 1}', b"[" + b"1," * (MAX_PAYLOAD // 2) + b"1]", '{"n": 2}')
    heard.wait_for(lambda h: len(h.inputs) == 2)
    assert heard.values() == [{"n": 1}, {"n": 2}]
    heard.wait_for(lambda h: h.drops == [("imu", "oversized")])


def test_a_key_that_is_too_long_is_counted_before_it_is_kept(listen, publish, mic):
    """To find a source's name in one of 60 kB held the operator up, for seconds with every sample."""
    heard = listen(mic)
    for size in (LONGEST_KEY + 1, LONGEST_KEY):
        publish(mic.key.replace("*", "x" * (size - len(mic.key) + 1)), "{}")
    heard.wait_for(lambda h: h.inputs and h.drops == [("mic", "oversized")])
    assert [len(sample.key) for sample in heard.inputs] == [LONGEST_KEY]


def test_a_deletion_is_not_a_sample(listen, robot_and_operator, publish, imu):
    heard = listen(imu)
    publish(imu.key, '{"n": 1}')
    robot_and_operator[0].delete(imu.key)
    publish(imu.key, '{"n": 2}')
    heard.wait_for(lambda h: len(h.values()) == 2)
    assert (heard.values(), heard.drops) == ([{"n": 1}, {"n": 2}], [])


def test_a_lost_liveliness_token_is_reported(listen, robot_and_operator, mic):
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


def test_a_stream_is_gone_with_the_last_of_its_senders(listen, robot_and_operator, publish, mic):
    robot, operator = robot_and_operator
    base = mic.key.partition("/")[0]
    mic = replace(mic, liveliness=f"{base}/*/alive")
    left, right = (robot.liveliness().declare_token(f"{base}/{side}/alive") for side in ("left", "right"))
    reported: list[zenoh.Sample] = []
    watcher = operator.liveliness().declare_subscriber(mic.liveliness, reported.append, history=True)
    until(lambda: len(reported) == 2)
    heard = listen(mic)
    left.undeclare()
    until(lambda: len(reported) == 3)
    publish(mic.key.replace("*", "right"), '{"level": 1}')
    heard.wait_for(lambda h: h.inputs)
    right.undeclare()
    heard.wait_for(lambda h: len(h.inputs) == 2)
    watcher.undeclare()
    assert [type(one) for one in heard.inputs] == [Sample, Gone]


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
def test_a_latched_topic_reaches_late_subscribers(listen, robot_and_operator, mission, late):
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


def test_a_latched_topic_is_received_once_its_publisher_is_reachable(loop, mission):
    endpoint, heard = f"tcp/127.0.0.1:{free_port()}", Heard()
    alone = {"connect/endpoints": [endpoint], "listen/endpoints": [], "connect/retry": RETRY}
    with open_session(**alone, **{"timestamping/enabled": True}) as robot:
        publisher = latched(robot, mission)
        publisher.put(int32(7))
        with open_session(**{"listen/endpoints": [endpoint]}) as operator:
            source = inputs(operator, [mission], loop, heard, backlog=Backlog(PER_STREAM, TOTAL))
            listening = source.subscribe(heard.on_next)
            heard.wait_for(lambda h: h.values("mission") == [{"data": 7}])
            listening.dispose()
        publisher.undeclare()


def test_a_sender_that_names_another_hides_none_of_its_samples(listen, robot_and_operator, mission):
    """A high number in its name made Zenoh's subscriber drop all that came from the other."""
    heard, robot = listen(mission), robot_and_operator[0]
    publisher = robot.declare_publisher(
        mission.key.replace("*", "hash"), congestion_control=zenoh.CongestionControl.BLOCK
    )
    Matching(publisher).wait(expected=True)
    for number in (2**31, 1, 2):
        publisher.put(int32(number % 100), source_info=zenoh.SourceInfo(publisher.id, number))
    heard.wait_for(lambda h: len(h.inputs) == 3)
    publisher.undeclare()
    assert heard.values("mission") == [{"data": 48}, {"data": 1}, {"data": 2}]


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


def test_disposal_stops_delivery(robot_and_operator, loop, publish, imu, mic):
    _, operator = robot_and_operator
    ended, other = Heard(), Heard()
    # First, so that the robot always knows of one: else it may look just when the ended one is gone.
    lasting = inputs(operator, [imu], loop, other, backlog=Backlog(PER_STREAM, TOTAL)).subscribe(other.on_next)
    inputs(operator, [imu, mic], loop, ended, backlog=Backlog(PER_STREAM, TOTAL)).subscribe(ended.on_next).dispose()
    publish(imu.key, "{}")
    other.wait_for(lambda h: h.inputs)
    lasting.dispose()
    assert ended.inputs == []
