from __future__ import annotations

import pytest

from robotkit.playback import Playback

S = 10**9


class Clock:
    """Virtual time: waiting for the end is what lets it pass."""

    def __init__(self):
        self.now = 1_000 * S
        self.end = None

    def __call__(self):
        return self.now

    def wait(self, seconds):
        self.now += round(seconds * S)
        return self.end is not None and self.now >= self.end


@pytest.fixture
def clock():
    return Clock()


def test_recorded_items_are_played_on_time(clock):
    recorded = [(500 * S, "a"), (501 * S, "b"), (503 * S, "c")]
    played = [(due - 1_000 * S, value, clock.now - due) for due, value in Playback(clock).play(recorded, clock)]
    assert played == [(0, "a", 0), (1 * S, "b", 0), (3 * S, "c", 0)]


def test_a_source_that_is_a_little_late_catches_up(clock):
    played = []
    for _, value in Playback(clock).play([(0, "a"), (S, "b"), (2 * S, "c")], clock):
        played.append(value)
        clock.now += S * 3 // 2 if value == "a" else 0
    assert played == ["a", "b", "c"]


def test_items_during_a_suspension_are_skipped(clock):
    playback, recorded = Playback(clock), [(second * S, second) for second in range(10)]
    clock.end = clock.now + 2 * S
    assert [value for _, value in playback.play(recorded, clock)] == [0, 1]
    clock.now, clock.end = 1_000 * S + 7 * S + 1, None
    assert [value for _, value in playback.play(recorded, clock)] == [7, 8, 9]
