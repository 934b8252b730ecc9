"""What agents don't wait for is done after a moment, in order."""

from __future__ import annotations

import pytest
from reactivex import Subject
from reactivex.testing import TestScheduler

from contextpolicy.bus.head_start import SECONDS, head_start


def is_for_agents(item: str) -> bool:
    return item.startswith("agent")


class Course:
    def __init__(self):
        self.scheduler = TestScheduler()
        self.done: list[tuple[str, float]] = []
        self.source: Subject[str] = Subject()
        self.scheduler.advance_to(10)
        held_back = self.source.pipe(head_start(self.scheduler, is_for_agents))
        self.end = held_back.subscribe(self.note, on_completed=lambda: self.note("end"))

    def note(self, item):
        self.done.append((item, round(self.scheduler.to_seconds(self.scheduler.now) - 10, 6)))


@pytest.fixture
def course():
    return Course()


def test_waiting_items_are_emitted_in_order(course):
    course.source.on_next("agent 1")
    course.scheduler.advance_by(SECONDS / 2)
    course.source.on_next("agent 2")
    assert course.done == []
    course.scheduler.advance_by(1)
    assert course.done == [("agent 1", SECONDS), ("agent 2", SECONDS)]
    course.source.on_next("agent 3")
    course.scheduler.advance_by(SECONDS)
    assert [name for name, _ in course.done] == ["agent 1", "agent 2", "agent 3"]


def test_other_items_pass_at_once_without_overtaking(course):
    course.source.on_next("alone")
    course.source.on_next("agent")
    course.source.on_next("after it")
    assert course.done == [("alone", 0)]
    course.scheduler.advance_by(1)
    assert [name for name, _ in course.done] == ["alone", "agent", "after it"]


def test_disposed_subscription_emits_nothing(course):
    course.source.on_next("agent")
    course.end.dispose()
    course.scheduler.advance_by(1)
    assert course.done == []


def test_completion_flushes_waiting_items_at_once(course):
    course.source.on_next("agent")
    course.source.on_completed()
    course.scheduler.advance_by(1)
    assert course.done == [("agent", 0), ("end", 0)]
