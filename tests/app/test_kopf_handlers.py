"""What kopf's handlers tell the operator, and what they tell kopf."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import kopf
import pytest

from contextpolicy.app import kopf_handlers
from tests.small_cluster import Told

APPLY: Any = kopf_handlers.apply
RELEASE: Any = kopf_handlers.release
"""Kopf calls them with two dozen arguments; they take what they need."""


def run(coroutine):
    return asyncio.run(coroutine)


def memo(told):
    return SimpleNamespace(operator=told.operator)


@pytest.fixture
def told():
    return Told()


def test_a_policy_is_handed_over_as_a_plain_object(told):
    run(APPLY(body=kopf.Body({"metadata": {"name": "robot"}, "spec": {}}), memo=memo(told)))
    assert told.calls == [("policy_changed", "robot")]
    assert type(told.operator.policy_changed.call_args.args[0]) is dict


def test_a_policy_that_names_what_is_not_there_yet_comes_again(told):
    told.readable = False
    with pytest.raises(kopf.TemporaryError) as caught:
        run(APPLY(body=kopf.Body({"metadata": {"name": "robot"}, "spec": {}}), memo=memo(told)))
    assert caught.value.delay == kopf_handlers.REREAD


def test_a_policy_goes_when_all_is_restored(told):
    told.restored.set_result(None)
    run(RELEASE(body=kopf.Body({"metadata": {"name": "robot"}}), memo=memo(told)))
    assert told.calls == [("policy_deleted", "robot")]


def test_a_restore_that_takes_long_is_asked_for_again(monkeypatch, told):
    monkeypatch.setattr(kopf_handlers, "RESTORE_TIMEOUT", 0.01)
    with pytest.raises(kopf.TemporaryError, match="not restored yet"):
        run(RELEASE(body=kopf.Body({"metadata": {"name": "robot"}}), memo=memo(told)))
    assert told.restored.cancelled(), "the operator may skip an answer that nobody awaits"
