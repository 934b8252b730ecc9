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


def test_a_refusal_says_what_was_repeated(heard):
    heard.check(KEY, b"plan")
    with pytest.raises(OrderError, match=KEY) as caught:
        heard.check(KEY, b"plan")
    assert caught.value.reason == "Repeated"


def test_each_message_counts_once_whatever_came_between(heard):
    assert not repeated(heard, b"older")
    assert not repeated(heard, b"newest")
    assert repeated(heard, b"older")
    assert repeated(heard, b"newest")


def test_saying_it_again_does_not_make_it_be_forgotten_later(heard, now):
    assert not repeated(heard, b"plan")
    now[0] += FRESH
    assert repeated(heard, b"plan")
    now[0] += 0.1
    assert not repeated(heard, b"plan")


def test_what_cannot_pass_for_fresh_any_more_takes_no_memory(heard, now):
    for number in range(1000):
        heard.check(KEY, str(number).encode())
        now[0] += 1
    assert len(heard._heard) == FRESH + 1
