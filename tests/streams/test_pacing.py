"""Items are emitted at a bounded rate, and the newest always."""

from __future__ import annotations

import pytest
from reactivex import Subject
from reactivex.testing import TestScheduler

from contextpolicy.streams.pacing import pace


def is_urgent(item: float) -> bool:
    return item < 0


class Story:
    """Items are their own times, in seconds; negative ones can't wait."""

    def __init__(self):
        self.scheduler = TestScheduler()
        self.seen: list[tuple[float, object]] = []
        self.source: Subject[float] = Subject()
        paced = self.source.pipe(pace(1.0, self.scheduler, at_once=is_urgent))
        self.end = paced.subscribe(self.note, on_completed=lambda: self.note("end"))

    def note(self, item):
        self.seen.append((self.scheduler.to_seconds(self.scheduler.now), item))

    def items(self, *items):
        for item in items:
            self.scheduler.advance_to(abs(item))
            self.source.on_next(item)


@pytest.fixture
def story():
    return Story()


def test_an_item_after_a_pause_is_emitted_at_once(story):
    story.items(1, 5)
    assert story.seen == [(1, 1), (5, 5)]


def test_a_flood_emits_the_newest_once_per_interval_and_the_last(story):
    story.items(*(10 + tick / 4 for tick in range(10)))
    story.scheduler.advance_to(60)
    assert story.seen == [(10, 10), (11, 10.75), (12, 11.75), (13, 12.25)]


def test_an_urgent_item_replaces_the_waiting_one(story):
    story.items(1, 1.5, -1.75)
    assert story.seen == [(1, 1), (1.75, -1.75)]
    story.items(2.5)
    assert len(story.seen) == 2, "the interval began again"
    story.scheduler.advance_to(60)
    assert story.seen[2:] == [(2.75, 2.5)]


def test_no_timer_runs_without_items(story):
    story.items(1)
    assert len(story.scheduler._queue) == 0


def test_disposal_stops_pending_items(story):
    story.items(1, 1.5)
    story.end.dispose()
    story.scheduler.advance_to(60)
    assert story.seen == [(1, 1)]


def test_the_last_item_is_emitted_before_completion(story):
    story.items(1, 1.5)
    story.source.on_completed()
    story.scheduler.advance_to(60)
    assert story.seen == [(1, 1), (1.5, 1.5), (1.5, "end")]
