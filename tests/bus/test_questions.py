"""Questions from the bus take turns with what else the loop has to do."""

import itertools
from typing import Any, cast

import pytest
from reactivex.testing import TestScheduler

from contextpolicy.bus.questions import BUFFER, LARGEST_QUESTION, MOST_BYTES, MOST_WAITING, REST, Questions
from tests.bus.fake_session import Query

TOOK = 0.01


@pytest.fixture
def loop():
    return TestScheduler()


def slow(loop):
    """Each answer takes a hundredth of a second by its clock, which is looked at before and after it."""
    clock = itertools.count()
    return Questions(loop, lambda: next(clock) * TOOK)


def ask(questions, answer, about="lab/robot", **carried):
    query = Query(**carried)
    questions.ask(about, cast("Any", query), lambda _: answer())
    return query


def nothing():
    """An answer."""


def test_plan_waits_for_at_most_one_answer(loop):
    questions, done = slow(loop), []
    for number in range(MOST_WAITING):
        ask(questions, lambda number=number: done.append(number))
    loop.schedule(lambda *_: done.append("plan"))
    loop.advance_by(REST * TOOK / 2)
    assert done == [0, "plan"]


def test_questions_are_answered_in_order_with_pauses_for_the_loop(loop):
    questions, done = slow(loop), []
    for number in range(3):
        ask(questions, lambda number=number: done.append((number, round(loop.clock, 3))))
    loop.advance_by(1.0)
    assert done == [(0, 0.0), (1, REST * TOOK), (2, 2 * REST * TOOK)]


def test_failing_answer_does_not_block_the_others(loop):
    questions, done = slow(loop), []

    def fail():
        raise RuntimeError("no")

    failed = ask(questions, fail)
    ask(questions, lambda: done.append(1))
    with pytest.raises(RuntimeError):
        loop.advance_by(1.0)
    assert failed.ended
    loop.stop()
    loop.advance_by(1.0)
    ask(questions, lambda: done.append(2))
    loop.advance_by(1.0)
    assert done == [1, 2]


def test_each_policy_has_its_own_places(loop):
    questions = slow(loop)
    for _ in range(2):
        queries = [ask(questions, nothing) for _ in range(MOST_WAITING + 1)]
        other = ask(questions, nothing, about="lab/other")
        assert [query.ended for query in (*queries, other)] == [False] * MOST_WAITING + [True, False]
        loop.advance_by(60.0)
        assert all(query.ended for query in (*queries, other))


@pytest.mark.parametrize("part", ["payload", "attachment", "parameters"])
def test_large_question_is_ended_at_once_whatever_its_size_is_made_of(loop, part):
    """Attachments and parameters of any size were kept until the answer: 32 for each policy, of 8 MiB."""
    questions, fill = slow(loop), cast("Any", "x" if part == "parameters" else b"x")
    small, large = (ask(questions, nothing, **{part: fill * size}) for size in (LARGEST_QUESTION, LARGEST_QUESTION + 1))
    assert (small.ended, large.ended) == (False, True)


def test_questions_about_all_policies_are_bounded_together(loop):
    """Each keeps the whole buffer in which it arrived."""
    questions = slow(loop)
    for _ in range(2):
        queries = [
            ask(questions, nothing, about=f"lab/{policy}", payload=b"x") for policy in range(30) for _ in range(10)
        ]
        waiting = sum(not query.ended for query in queries)
        assert 0.9 * MOST_BYTES < waiting * BUFFER <= MOST_BYTES
        loop.advance_by(60.0)
        assert all(query.ended for query in queries)


def test_one_question_to_each_of_many_policies_is_admitted(loop):
    questions = slow(loop)
    assert not any(ask(questions, nothing, about=f"lab/{policy}").ended for policy in range(4000))
