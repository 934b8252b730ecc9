from __future__ import annotations

import time
from contextlib import ExitStack
from types import SimpleNamespace
from unittest.mock import Mock

import pytest
import zenoh

from robotkit import Input
from robotkit.inputs import Inputs
from robotkit.newest import Newest
from robotkit.stamps import attachment
from tests.modules.robotkit.bus import Matching, ask, client, router, soon
from tests.ports import free_port
from tests.waiting import PATIENCE


@pytest.fixture(scope="module")
def sessions():
    with router() as address, client(address) as sensor, client(address) as module:
        yield sensor, module


@pytest.fixture
def sensor_and_input(sessions, request):
    sensor, module = sessions
    key = f"test/{request.node.name}"
    publisher = sensor.declare_publisher(key)
    matching = Matching(publisher)
    source = Inputs(module, {"one": Input(key, depth=2)})
    source.resume()
    matching.wait(expected=True)
    yield publisher, matching, source
    source.close()


def test_a_sample_keeps_the_time_of_its_source(sensor_and_input):
    publisher, _, source = sensor_and_input
    publisher.put(b"picture", attachment=attachment(123))
    received = soon(source.take)
    assert (received.payload, received.stamp) == (b"picture", 123)
    assert received.received > 123


@pytest.mark.parametrize("foreign", [None, b"\xff", b"[]", b'{"stamp": "now"}'])
def test_a_sample_without_a_stamp_has_that_of_its_arrival(sensor_and_input, foreign):
    publisher, _, source = sensor_and_input
    publisher.put(b"x", attachment=foreign)
    received = soon(source.take)
    assert received.stamp == received.received


def test_a_slow_task_gets_the_newest_samples_and_counts_drops(sensor_and_input):
    publisher, _, source = sensor_and_input
    for number in range(5):
        publisher.put(bytes([number]))
    while source.dropped["one"] < 3:
        with source._changed:
            assert source._changed.wait(PATIENCE)
    assert [soon(source.take).payload for _ in range(2)] == [b"\x03", b"\x04"]


def test_a_paused_input_is_unsubscribed(sensor_and_input):
    publisher, matching, source = sensor_and_input
    source.pause()
    matching.wait(expected=False)
    source.resume()
    matching.wait(expected=True)
    publisher.put(b"again")
    assert soon(source.take).payload == b"again"


def test_closing_wakes_the_task(sensor_and_input):
    _, _, source = sensor_and_input
    source.close()
    assert soon(source.take) is None


def test_an_input_survives_the_routers_restart():
    port = free_port()
    address = f"tcp/127.0.0.1:{port}"
    with ExitStack() as first, ExitStack() as sessions:
        first.enter_context(router(port))
        sensor, module = (sessions.enter_context(client(address)) for _ in range(2))
        publisher = sensor.declare_publisher("test/restart")
        matching = Matching(publisher)
        source = Inputs(module, {"one": Input("test/restart")})
        source.resume()
        matching.wait(expected=True)
        first.close()
        matching.wait(expected=False)
        with router(port):
            matching.wait(expected=True)
            publisher.put(b"back")
            assert soon(source.take).payload == b"back"
        source.close()


def test_a_resumed_input_has_what_was_published_just_before(sessions):
    sensor, module = sessions
    newest = Newest(sensor, "test/just-before", zenoh.Encoding.ZENOH_BYTES)
    newest.keep(b"older", attachment(1))
    newest.keep(b"seen", attachment(stamp := time.time_ns()))
    ask(module, "test/just-before")
    source = Inputs(module, {"one": Input("test/just-before")}, deadline=PATIENCE)
    source.resume()
    received = soon(source.take)
    assert (received.payload, received.stamp) == (b"seen", stamp)
    assert received.received > stamp
    source.close()
    newest.close()


def sample(payload, stamp, key="test/one"):
    kept = None if stamp is None else zenoh.ZBytes(attachment(stamp))
    return SimpleNamespace(payload=zenoh.ZBytes(payload), attachment=kept, key_expr=key)


class Asked:
    """Inputs that have resumed, and ways to let samples and answers come."""

    def __init__(self, deadline=PATIENCE, depth=1):
        self.session = Mock()
        self.inputs = Inputs(self.session, {"one": Input("test/*", depth=depth)}, deadline)
        self.inputs.resume()

    def published(self, *one):
        self.session.declare_subscriber.call_args.args[1](sample(*one))

    def answered(self, *one):
        self.session.get.call_args.args[1](SimpleNamespace(ok=sample(*one)))

    def taken(self):
        """What waits, or nothing."""
        return [soon(self.inputs.take).payload] if self.inputs.unfinished else []


def test_an_answer_is_taken_once_and_in_order():
    asked, now = Asked(), time.time_ns()
    asked.answered(b"newest", now)
    asked.answered(b"the same again", now)
    asked.published(b"the same, overtaken by the answer", now)
    asked.published(b"older", now - 1)
    assert asked.inputs.dropped == {"one": 0}
    assert asked.taken() == [b"newest"]
    asked.published(b"next", now + 1)
    assert soon(asked.inputs.take).payload == b"next"


def test_an_answer_that_has_come_or_is_overtaken_is_ignored():
    asked, now = Asked(), time.time_ns()
    asked.published(b"live", now)
    asked.answered(b"live", now)
    asked.answered(b"older", now - 1)
    assert asked.taken() == [b"live"]
    assert asked.inputs.dropped == {"one": 0}


def test_each_key_of_an_input_has_its_own_newest_sample():
    asked, now = Asked(), time.time_ns()
    asked.published(b"live", now)
    asked.answered(b"older, of another key", now - 1, "test/other")
    assert asked.inputs.dropped == {"one": 1}
    assert asked.taken() == [b"older, of another key"]


def test_a_stamp_in_the_future_is_no_age_and_hides_no_later_answer():
    asked, ahead = Asked(), time.time_ns() + 3600 * 10**9
    asked.answered(b"of the future", ahead)
    assert asked.inputs.unfinished == []
    asked.published(b"live", ahead)
    assert asked.taken() == [b"live"]
    asked.answered(b"newest", time.time_ns())
    assert soon(asked.inputs.take).payload == b"newest"


def test_a_queue_is_not_asked_for():
    """An order by itself may have been revoked by another publisher, who does not answer."""
    assert not Asked(depth=2).session.get.called


@pytest.mark.parametrize("stamp", [None, 1])
def test_an_answer_past_its_deadline_or_of_unknown_age_is_ignored(stamp):
    asked = Asked()
    asked.answered(b"old", stamp)
    assert asked.taken() == []


def test_an_answer_that_comes_after_another_pause_is_ignored():
    asked, now = Asked(), time.time_ns()
    late = asked.session.get.call_args.args[1]
    asked.inputs.pause()
    late(SimpleNamespace(ok=sample(b"late", now)))
    asked.inputs.resume()
    assert asked.taken() == []


def test_a_refused_question_is_no_answer():
    asked = Asked()
    asked.session.get.call_args.args[1](SimpleNamespace(ok=None))
    assert asked.taken() == []


def test_an_answer_never_blocks_the_bus():
    assert Asked().session.get.call_args.kwargs["congestion_control"] == zenoh.CongestionControl.DROP


def test_without_a_deadline_nothing_is_asked_for():
    assert not Asked(deadline=None).session.get.called
