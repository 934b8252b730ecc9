"""Often enough, not too often, and the last word always."""

from __future__ import annotations

import pytest
from reactivex.testing import TestScheduler

from contextpolicy.bus.pacing import Pacing


class Teller:
    def __init__(self):
        self.scheduler = TestScheduler()
        self.told = []
        self.pacing = Pacing(self.scheduler, 1.0, lambda: self.told.append(self.now()))

    def now(self):
        return self.scheduler.to_seconds(self.scheduler.now)

    def news(self, *times):
        for at in times:
            self.scheduler.advance_to(at)
            self.pacing.ask()


@pytest.fixture
def teller():
    return Teller()


def test_news_after_a_rest_is_told_at_once(teller):
    teller.news(1, 5)
    assert teller.told == [1, 5]


def test_a_flood_is_told_once_in_an_interval_and_to_the_end(teller):
    teller.news(*(10 + tick / 100 for tick in range(250)))
    teller.scheduler.advance_to(60)
    assert teller.told == [10, 11, 12, 13]


def test_what_is_told_otherwise_counts(teller):
    teller.news(1, 1.5)
    teller.pacing.rest()
    teller.scheduler.advance_to(2.4)
    assert teller.told == [1]
    teller.pacing.ask()
    teller.scheduler.advance_to(60)
    assert teller.told == [1, 2.5]


def test_nothing_is_told_after_the_end(teller):
    teller.news(1, 1.5)
    teller.pacing.stop()
    teller.scheduler.advance_to(60)
    assert teller.told == [1]
