"""Weights are written at once; a suspended task is capped once the input that it is at is done."""

from __future__ import annotations

import pytest

from contextpolicy.agent.drains import DRAIN
from tests.agent.builders import CHAT, POLICY, a_message, a_target
from tests.agent.weighted_plans.node import ACTIVE, ASLEEP


def test_a_suspended_task_has_the_least_weight_at_once_and_is_capped_later(node):
    node.plan(ACTIVE, (0.3, 0.5))
    node.plan(ACTIVE, ASLEEP)
    assert (node.weights(), node.limits()) == (node.expected(1500, 0), (500, 500))
    node.wait(DRAIN - 0.01)
    assert node.limits() == (500, 500)
    node.wait(0.02)
    assert node.limits() == (500, 10)


def test_later_plans_do_not_postpone_the_cap(node):
    node.plan(ACTIVE, (0.3, 0.5))
    for _ in range(4):
        node.plan(ACTIVE, ASLEEP)
        node.wait(DRAIN / 3)
    assert node.limits() == (500, 10)


def test_task_resumed_before_the_drain_ends_is_never_capped(node):
    node.plan(ACTIVE, ASLEEP)
    node.wait(DRAIN / 2)
    node.plan(ACTIVE, (0.3, 0.5))
    node.wait(2 * DRAIN)
    assert node.limits() == (500, 500)


def test_a_task_wakes_at_once(node):
    node.plan(ACTIVE, ASLEEP)
    node.wait(1)
    node.plan(ACTIVE, (0.3, 0.5))
    assert (node.weights(), node.limits()) == (node.expected(1500, 300), (500, 500))


def test_suspended_task_stays_capped_when_another_is_suspended(node):
    node.plan(ACTIVE, ASLEEP)
    node.wait(1)
    node.plan(ASLEEP, ASLEEP)
    assert node.limits() == (500, 10)
    node.wait(1)
    assert node.limits() == (10, 10)


def test_without_weights_a_quota_comes_at_once(node):
    node.plan((None, 0.5), (None, 0.01))
    assert (node.limits(), node.weights()) == ((500, 10), (100, 100) if node.tree.version == 2 else (1024, 1024))


def test_each_suspended_task_has_its_own_drain_time(node):
    node.plan(ACTIVE, (0.3, 0.5))
    node.plan(ACTIVE, ASLEEP)
    node.wait(DRAIN - 0.02)
    node.plan(ASLEEP, ASLEEP)
    node.wait(0.05)
    assert node.limits() == (500, 10)
    node.wait(DRAIN)
    assert node.limits() == (10, 10)


def test_resuming_a_task_restarts_its_drain_time(node):
    node.plan(ASLEEP, ACTIVE)
    node.wait(0.3)
    node.plan(ACTIVE, ASLEEP)
    node.wait(0.15)
    node.plan(ASLEEP, ACTIVE)
    node.wait(0.1)
    assert node.limits() == (500, 500)


@pytest.mark.parametrize("agreed", [False, True])
def test_suspended_task_stays_capped_across_an_agent_restart(node, agreed):
    node.plan(ACTIVE, ASLEEP)
    node.wait(1)
    if agreed:
        node.kubelet(node.speech, 10)
    node.start()
    node.plan(ACTIVE, ASLEEP, limit=0.01 if agreed else 0.5)
    assert node.limits() == (500, 10)
    node.wait(1)
    assert node.limits() == (500, 10)


def test_the_end_of_a_drain_leaves_a_value_that_another_writer_set_elsewhere(node):
    node.plan(ACTIVE, ASLEEP)
    node.kubelet(node.slam, 300)
    node.wait(DRAIN + 0.1)
    assert node.limits() == (300, 10)


def test_the_end_of_a_drain_leaves_a_value_that_the_watch_has_yet_to_report(node):
    node.plan(ACTIVE, ASLEEP)
    node.tree.set(node.slam, 300)
    node.wait(DRAIN + 0.1)
    assert node.limits() == (300, 10)


def test_a_drained_task_is_capped_whatever_another_writer_set_meanwhile(node):
    node.plan(ACTIVE, ASLEEP)
    node.kubelet(node.speech, 300)
    node.wait(DRAIN + 0.1)
    assert node.limits() == (500, 10)


def suspend_chat(node, qos, **more):
    """Its pod has no weight that a plan could move."""
    chat = node.tree.container(CHAT, qos=qos)
    target = a_target(CHAT, 0.01, task="chat", qos=qos)
    node.agent.hear(POLICY, a_message(target, suspended=("chat",), **more))
    return chat


@pytest.mark.parametrize("qos", ["BestEffort", "Guaranteed"])
def test_a_suspended_task_without_a_weight_has_its_drain_time_too(node, qos):
    chat = suspend_chat(node, qos, control="Weight")
    node.wait(DRAIN - 0.01)
    assert node.tree.limit(chat) == 500
    node.wait(0.02)
    assert node.tree.limit(chat) == 10


@pytest.mark.parametrize("control", ["Suspend", "Limit"])
def test_other_controls_cap_a_suspended_task_at_once(node, control):
    assert node.tree.limit(suspend_chat(node, "Burstable", control=control)) == 10
