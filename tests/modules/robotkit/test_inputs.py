from __future__ import annotations

from contextlib import ExitStack

import pytest

from robotkit import Input
from robotkit.inputs import Inputs
from robotkit.stamps import attachment
from tests.modules.robotkit.bus import Matching, client, router, soon
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
