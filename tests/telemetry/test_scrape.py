"""What /metrics says about the present, in virtual time."""

from __future__ import annotations

import pytest
from prometheus_client import CollectorRegistry, generate_latest

from contextpolicy.telemetry.scrape import Scrape
from tests.cluster.builders import a_pod
from tests.policies.builders import IMU, a_policy, resources
from tests.virtual_operator import VirtualOperator

POLICY = {"namespace": "lab", "name": "robot"}


@pytest.fixture
def operator():
    started = VirtualOperator(*(a_pod(name, {name: resources()}) for name in ("slam", "speech")))
    started.list_all()
    return started


@pytest.fixture
def page(operator):
    """A registry whose scrape asks the loop, which answers at once."""
    registry = CollectorRegistry()

    def read():
        operator.loop.inline = True
        try:
            return operator.operator.queries.scrape()
        finally:
            operator.loop.inline = False

    registry.register(Scrape(read))
    return registry


def govern(operator):
    operator.connect()
    operator.apply(a_policy())
    operator.sample(IMU, speed=0.3)
    operator.settle()


def value(page, name, **labels):
    return page.get_sample_value(f"contextpolicy_{name}", {**POLICY, **labels})


def test_before_there_is_a_bus_or_a_policy(operator, page):
    assert page.get_sample_value("contextpolicy_bus_connected") == 0
    operator.apply(a_policy())
    assert value(page, "condition", type="Ready") is None or value(page, "condition", type="Ready") == 0


def test_what_is_the_case_while_a_robot_moves(operator, page):
    govern(operator)
    operator.turn(2.0)
    assert page.get_sample_value("contextpolicy_bus_connected") == 1
    assert value(page, "condition", type="Ready") == 1
    assert value(page, "stream_age_seconds", stream="imu") == pytest.approx(2.3, abs=0.5)
    assert value(page, "stream_silent", stream="imu") == 0
    assert value(page, "samples_total", stream="imu") == 1
    assert value(page, "context_transitions_total", context="moving") == 1
    assert value(page, "container_limit_cores", task="slam", pod="slam", container="slam") == 0.8


def test_a_router_that_is_gone_and_a_stream_that_is_silent(operator, page):
    govern(operator)
    operator.turn(11.0)
    operator.session.lose_router()
    operator.turn(11.0)
    assert page.get_sample_value("contextpolicy_bus_connected") == 0
    assert value(page, "stream_silent", stream="imu") == 1
    assert value(page, "condition", type="StreamsHealthy") == 0


def test_an_edit_goes_on_counting_samples(operator, page):
    govern(operator)
    operator.apply(a_policy(generation=2, enforcement={"minDwell": "1s"}))
    operator.sample(IMU, speed=0.2)
    assert value(page, "samples_total", stream="imu") == 2


def test_a_deleted_policy_leaves_nothing_behind(operator, page):
    govern(operator)
    operator.delete(a_policy())
    operator.settle()
    assert 'name="robot"' not in generate_latest(page).decode()


def test_a_loop_that_hangs_costs_only_its_own_metrics():
    registry = CollectorRegistry()
    registry.register(Scrape(lambda: None))
    assert generate_latest(registry) == b""
