"""Questions from the bus take turns with what else the loop has to do."""

import itertools

import pytest
from reactivex.testing import TestScheduler

from contextpolicy.bus.questions import REST, Questions

TOOK = 0.01


@pytest.fixture
def loop():
    return TestScheduler()


def slow(loop):
    """Each answer takes a hundredth of a second by its clock, which is looked at before and after it."""
    clock = itertools.count()
    return Questions(loop, lambda: next(clock) * TOOK)


def test_plan_waits_for_at_most_one_answer(loop):
    questions, done = slow(loop), []
    for number in range(100):
        questions.ask(lambda number=number: done.append(number))
    loop.schedule(lambda *_: done.append("plan"))
    loop.advance_by(REST * TOOK / 2)
    assert done == [0, "plan"]


def test_questions_are_answered_in_order_with_pauses_for_the_loop(loop):
    questions, done = slow(loop), []
    for number in range(3):
        questions.ask(lambda number=number: done.append((number, round(loop.clock, 3))))
    loop.advance_by(1.0)
    assert done == [(0, 0.0), (1, REST * TOOK), (2, 2 * REST * TOOK)]


def test_failing_answer_does_not_block_the_others(loop):
    questions, done = slow(loop), []

    def fail():
        raise RuntimeError("no")

    questions.ask(fail)
    questions.ask(lambda: done.append(1))
    with pytest.raises(RuntimeError):
        loop.advance_by(1.0)
    loop.stop()
    loop.advance_by(1.0)
    questions.ask(lambda: done.append(2))
    loop.advance_by(1.0)
    assert done == [1, 2]
