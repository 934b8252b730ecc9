"""A newer plan that is refused: what was written for the one before is no longer defended against resizes."""

from __future__ import annotations

from time import monotonic

import pytest

from contextpolicy.errors import OrderError
from tests.agent.builders import POLICY, TIMES
from tests.agent.weighted_plans.node import ACTIVE, ASLEEP, refuse


@pytest.fixture
def before(node):
    """What the API has."""
    return node.everything()


@pytest.fixture
def suspended(node, before):  # noqa: ARG001 - noted first
    """Speech is suspended by a quota that the API can't hold, and slam has a weight."""
    node.plan(ACTIVE, ASLEEP, held=True)
    node.wait(1)
    assert node.limits() == (500, 10)
    return node


def overwritten(node):
    """The kubelet writes what the API has: a limit and a weight."""
    node.kubelet(node.speech, 500)
    node.tree.set_weight(node.slam, 77)
    node.agent.on_other_write(node.tree.weight_file(node.slam), monotonic())
    return node.limits()[1], node.tree.weight(node.slam)


KEPT, RESTORED = (500, 77), 10


def test_too_large_a_plan_ends_the_defence_of_the_one_before(suspended):
    assert suspended.agent.hear(POLICY, suspended.next_message(capacity=64)) is None
    assert overwritten(suspended) == KEPT


@pytest.mark.parametrize("payload", [b"of another version", None], ids=["unreadable", "withdrawal"])
def test_a_message_without_a_stamp_counts_by_its_time_of_signing(suspended, payload):
    suspended.agent.miss(POLICY, payload, 1)
    assert overwritten(suspended)[0] == RESTORED
    suspended.agent.miss(POLICY, payload, next(TIMES))
    assert overwritten(suspended) == KEPT


def test_unreadable_plan_of_the_operator_ends_the_defence_of_the_one_before(suspended):
    assert suspended.agent.hear(POLICY, b"of another version") is None
    assert overwritten(suspended) == KEPT


def test_a_newer_plan_that_the_clocks_forbid_ends_the_defence_of_the_one_before(suspended):
    suspended.agent.miss(POLICY, suspended.next_message(), 1)
    assert overwritten(suspended) == KEPT


def test_everything_that_only_the_agent_could_undo_is_undone(suspended, before):
    suspended.agent.hear(POLICY, suspended.next_message(capacity=64))
    assert suspended.everything() == before


def test_what_the_api_agrees_with_stays(suspended):
    suspended.plan(ACTIVE, ASLEEP)
    suspended.kubelet(suspended.speech, 10)
    suspended.agent.hear(POLICY, suspended.next_message(capacity=64))
    assert suspended.limits() == (500, 10)


def test_what_cannot_be_undone_is_tried_again(suspended, before, monkeypatch):
    with monkeypatch.context() as broken:
        broken.setattr("os.pwrite", refuse)
        suspended.agent.hear(POLICY, suspended.next_message(capacity=64))
    assert suspended.everything() != before
    suspended.wait(2)
    assert suspended.everything() == before


def test_the_next_plan_that_is_accepted_is_carried_out(suspended):
    suspended.agent.hear(POLICY, suspended.next_message(capacity=64))
    assert suspended.plan(ACTIVE, ASLEEP, held=True).failed == {}
    suspended.wait(1)
    assert overwritten(suspended)[0] == RESTORED


def test_older_plans_do_not_end_the_defence(suspended):
    suspended.plan(ACTIVE, ASLEEP, held=True)
    for message in (suspended.message(1, capacity=64), suspended.message(1)):
        assert suspended.agent.hear(POLICY, message) is None
        suspended.agent.miss(POLICY, message, next(TIMES))
    assert overwritten(suspended)[0] == RESTORED


@pytest.mark.parametrize("reason", ["Unsigned", "Forged", "TooOld", "Repeated"])
def test_messages_that_prove_nothing_do_not_end_the_defence(suspended, reason):
    suspended.agent.refuse(OrderError(reason, "somebody sent this"))
    assert overwritten(suspended)[0] == RESTORED


def test_refused_plan_without_a_source_undoes_everything(suspended, before):
    suspended.plan(ACTIVE, ASLEEP)
    suspended.kubelet(suspended.speech, 10)
    suspended.agent.lose_source(POLICY)
    suspended.agent.hear(POLICY, suspended.next_message(capacity=64))
    assert suspended.limits() == before[1]


def test_a_plan_that_its_source_does_not_prove_is_no_longer_defended(suspended, before):
    """Its key was replaced before the agent had the new certificate: all that the operator says is refused."""
    assert suspended.agent.doubt(POLICY)
    suspended.wait(9)
    suspended.kubelet(suspended.speech, 500)
    assert suspended.limits()[1] == RESTORED
    suspended.wait(2)
    assert suspended.everything() == before
    assert overwritten(suspended) == KEPT


def test_what_the_api_agrees_with_stays_when_a_source_proves_nothing(suspended):
    suspended.plan(ACTIVE, ASLEEP)
    suspended.kubelet(suspended.speech, 10)
    suspended.agent.doubt(POLICY)
    suspended.wait(11)
    assert suspended.limits() == (500, 10)


def test_a_plan_that_its_source_repeats_stays_in_force(suspended):
    suspended.agent.doubt(POLICY)
    suspended.wait(9)
    suspended.repeat(ACTIVE, ASLEEP, held=True)
    suspended.wait(100)
    assert overwritten(suspended)[0] == RESTORED


def test_a_plan_with_the_new_key_is_carried_out_after_the_former_one_was_given_up(suspended):
    suspended.agent.doubt(POLICY)
    suspended.wait(11)
    assert suspended.repeat(ACTIVE, ASLEEP, held=True).failed == {}
    suspended.wait(1)
    assert suspended.limits() == (500, 10)


def test_without_a_plan_or_a_source_there_is_nothing_to_doubt(suspended):
    assert not suspended.agent.doubt("robot/other")
    suspended.agent.lose_source(POLICY)
    assert not suspended.agent.doubt(POLICY)
