"""What agents don't wait for is done after a moment, in order."""

from __future__ import annotations

import pytest
from reactivex.testing import TestScheduler

from contextpolicy.bus.head_start import SECONDS, HeadStart


class Course:
    def __init__(self):
        self.scheduler = TestScheduler()
        self.scheduler.advance_to(10)
        self.done = []
        self.start = HeadStart(self.scheduler)

    def note(self, name):
        return lambda: self.done.append((name, round(self.scheduler.to_seconds(self.scheduler.now) - 10, 6)))


@pytest.fixture
def course():
    return Course()


def test_all_that_waits_is_done_in_order_a_moment_after_the_first(course):
    course.start.later(course.note("order"))
    course.scheduler.advance_by(SECONDS / 2)
    course.start.later(course.note("log"))
    assert course.done == []
    course.scheduler.advance_by(1)
    assert course.done == [("order", SECONDS), ("log", SECONDS)]
    course.start.later(course.note("next"))
    course.scheduler.advance_by(SECONDS)
    assert [name for name, _ in course.done] == ["order", "log", "next"]


def test_what_has_a_turn_goes_after_what_waits_and_at_once_if_nothing_does(course):
    course.start.in_turn(course.note("alone"))
    course.start.later(course.note("first"))
    course.start.in_turn(course.note("second"))
    assert course.done == [("alone", 0)]
    course.scheduler.advance_by(1)
    assert [name for name, _ in course.done] == ["alone", "first", "second"]


def test_nothing_is_done_after_the_end(course):
    course.start.later(course.note("order"))
    course.start.stop()
    course.scheduler.advance_by(1)
    assert course.done == []
