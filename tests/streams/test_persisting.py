"""A failing subscriber gets its item again, and others are not affected."""

from __future__ import annotations

import pytest
from reactivex import Subject
from reactivex.testing import TestScheduler

from contextpolicy.streams.persisting import RETRY, persist

HOUR = 3600


class Story:
    def __init__(self):
        self.scheduler, self.source = TestScheduler(), Subject[str]()
        self.failures = 0
        """How many times the subscriber fails from now on."""
        self.taken, self.attempts = [], 0
        self.end = persist(self.source, self.take, self.scheduler)

    def take(self, item):
        self.attempts += 1
        if self.failures:
            self.failures -= 1
            raise KeyError(item)
        self.taken.append(item)


@pytest.fixture
def story():
    return Story()


def test_a_failure_is_logged_and_retried_until_success(story, caplog):
    story.failures = 2
    story.source.on_next("a")
    assert (story.taken, caplog.messages) == ([], [f"internal error; next attempt in {RETRY:g} s"])
    assert "KeyError: 'a'" in caplog.text
    story.scheduler.advance_by(HOUR)
    assert (story.taken, story.attempts) == (["a"], 3)


def test_a_newer_item_takes_the_place_of_the_one_that_failed(story):
    story.failures = 1
    story.source.on_next("a")
    story.source.on_next("b")
    story.scheduler.advance_by(HOUR)
    assert story.taken == ["b"]


def test_later_subscribers_get_the_item_despite_a_failure(story):
    heard: list[str] = []
    story.source.subscribe(heard.append)
    story.failures = 1
    story.source.on_next("a")
    assert heard == ["a"]


def test_disposal_stops_retries(story):
    story.failures = 1
    story.source.on_next("a")
    story.end.dispose()
    story.scheduler.advance_by(HOUR)
    assert story.attempts == 1
