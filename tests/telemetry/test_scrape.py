"""What /metrics says about the present, in virtual time."""

from __future__ import annotations

import pytest
from prometheus_client import REGISTRY, CollectorRegistry, generate_latest

from contextpolicy.bus.agent_watch import RETURN
from contextpolicy.telemetry.scrape import Scrape
from tests.actuators.resize.fake_cluster import refusal
from tests.cluster.builders import NODE, a_pod
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
    operator.react(IMU, speed=0.3)


def value(page, name, **labels):
    return page.get_sample_value(f"contextpolicy_{name}", {**POLICY, **labels})


def test_metrics_before_the_bus_is_connected(operator, page):
    assert page.get_sample_value("contextpolicy_bus_connected") == 0
    operator.apply(a_policy())
    assert value(page, "condition", type="Ready") is None or value(page, "condition", type="Ready") == 0


def test_metrics_of_a_moving_robot(operator, page):
    govern(operator)
    operator.turn(2.0)
    assert page.get_sample_value("contextpolicy_bus_connected") == 1
    assert value(page, "condition", type="Ready") == 1
    assert value(page, "stream_age_seconds", stream="imu") == pytest.approx(2.3, abs=0.5)
    assert value(page, "stream_silent", stream="imu") == 0
    assert value(page, "samples_total", stream="imu") == 1
    assert value(page, "context_transitions_total", context="moving") == 1
    assert value(page, "container_limit_cores", task="slam", pod="slam", container="slam") == 0.8


def test_metrics_of_a_lost_router_and_a_silent_stream(operator, page):
    govern(operator)
    operator.turn(11.0)
    operator.session.lose_router()
    operator.turn(11.0)
    assert page.get_sample_value("contextpolicy_bus_connected") == 0
    assert value(page, "stream_silent", stream="imu") == 1
    assert value(page, "condition", type="StreamsHealthy") == 0


def test_delay_of_old_kubelets_is_exported(operator, page):
    """An alert on slow reactions allows for that delay; an old node without the policy's pods does not count."""
    govern(operator)

    def delay():
        return value(page, "kubelet_delay_seconds")

    assert delay() == 0
    operator.node(name="old", kubelet="v1.35.2")
    assert delay() == 0
    operator.node(kubelet="v1.34.0")
    assert delay() == 2
    operator.session.agents[NODE] = b'{"missing": {"CFS": [], "Realtime": []}}'
    operator.connect()
    operator.settle()
    assert delay() == 0


def test_an_edit_continues_counting_samples(operator, page):
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


AGENT = b'{"missing": {"CFS": [], "Realtime": []}}'


def agent_ready(page, node=NODE):
    return page.get_sample_value("contextpolicy_node_agent_ready", {"node": node})


def lose_agent(operator):
    operator.session.agent_gone(NODE)
    operator.turn(RETURN + 1)


def test_a_lost_agent_is_not_ready(operator, page):
    """A series that ends raises no alert."""
    operator.session.agents[NODE] = AGENT
    operator.connect()
    operator.settle()
    assert agent_ready(page) == 1
    lose_agent(operator)
    assert agent_ready(page) == 0


@pytest.mark.parametrize("status", ["False", "Unknown"])
def test_the_agent_of_a_node_that_is_not_ready_is_not_missed(operator, page, status):
    operator.session.agents[NODE] = AGENT
    operator.connect()
    lose_agent(operator)
    operator.node(ready=status)
    assert agent_ready(page) is None
    operator.node()
    assert agent_ready(page) == 0


def test_an_agent_that_never_came_is_missed_where_every_node_is_to_have_one(operator, page):
    govern(operator)
    assert agent_ready(page) is None
    operator.agents_everywhere = True
    operator.start()
    operator.list_all()
    govern(operator)
    operator.node(name="without-tasks")
    assert agent_ready(page) == 0
    assert agent_ready(page, "without-tasks") is None


def test_a_policy_whose_containers_cannot_be_restored_is_not_ready(operator, page):
    """Its deletion lasts as long as that takes, and would go unnoticed."""
    govern(operator)
    operator.cluster.faults += [refusal("Forbidden")] * 9
    operator.delete(a_policy())
    operator.settle()
    operator.turn(2.0)
    assert value(page, "condition", type="Ready") == 0
    assert value(page, "stream_silent", stream="imu") is None
    assert REGISTRY.get_sample_value("contextpolicy_context_active", {**POLICY, "context": "moving"}) is None


def test_a_policy_that_is_created_again_while_the_old_one_leaves_has_only_its_own_series(operator):
    """A user gave up on its restoration and removed the finalizer."""
    govern(operator)
    operator.cluster.faults += [refusal("Forbidden")] * 9
    operator.delete(a_policy())
    operator.settle()
    operator.cluster.faults.clear()
    operator.apply(a_policy(contexts=[]))
    operator.settle()
    assert REGISTRY.get_sample_value("contextpolicy_context_active", {**POLICY, "context": "moving"}) is None
    assert REGISTRY.get_sample_value("contextpolicy_plans_total", POLICY) == 1
