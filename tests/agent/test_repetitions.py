"""A message that was signed once and is said twice."""

from __future__ import annotations

import pytest

from contextpolicy.agent.repetitions import FRESH, Repetitions
from contextpolicy.errors import OrderError

KEY = "contextpolicy/robot/delivery/plan"


@pytest.fixture
def now():
    return [100.0]


@pytest.fixture
def heard(now):
    return Repetitions(lambda: now[0])


def repeated(heard, attachment):
    try:
        heard.check(KEY, attachment)
    except OrderError:
        return True
    return False


def test_refusal_names_the_repeated_key(heard):
    heard.check(KEY, b"plan")
    with pytest.raises(OrderError, match=KEY) as caught:
        heard.check(KEY, b"plan")
    assert caught.value.reason == "Repeated"


def test_replayed_message_is_detected_after_newer_ones(heard):
    assert not repeated(heard, b"older")
    assert not repeated(heard, b"newest")
    assert repeated(heard, b"older")
    assert repeated(heard, b"newest")


def test_repetition_does_not_extend_the_replay_window(heard, now):
    assert not repeated(heard, b"plan")
    now[0] += FRESH
    assert repeated(heard, b"plan")
    now[0] += 0.1
    assert not repeated(heard, b"plan")


def test_expired_messages_are_forgotten(heard, now):
    for number in range(1000):
        heard.check(KEY, str(number).encode())
        now[0] += 1
    assert len(heard._heard) == FRESH + 1
