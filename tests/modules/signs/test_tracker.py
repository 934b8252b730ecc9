"""When a sign is reported, and when it is read at all; pictures are two a second."""

from __future__ import annotations

import numpy as np
import pytest

from modules.signs.reading import Character, Reading
from modules.signs.tracker import NUMBER, Tracker

SECOND = 10**9


def at(x, y=100, width=60, height=30):
    return np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]], np.float32)


def reading(text, confidence=0.95):
    return Reading(tuple(Character(letter, confidence, 0.5) for letter in text))


class Passage:
    """Feeds a tracker; `shown` maps x to the reading there."""

    def __init__(self):
        self.tracker = Tracker()
        self.time = 0.0
        self.reads = 0

    def see(self, shown, *, times=1, after=0.5):
        reported = []
        for _ in range(times):
            self.time += after
            reported += self.tracker.follow(
                [at(x) for x in shown], round(self.time * SECOND), lambda c: self._read(shown, c)
            )
        return [(sign.text, sign.confidence) for sign in reported]

    def _read(self, shown, corners):
        self.reads += 1
        return shown[corners[0][0]]


@pytest.fixture
def passage():
    return Passage()


def test_a_sign_is_reported_once_two_pictures_agree(passage):
    assert passage.see({100: reading("214")}) == []
    assert passage.see({102: reading("214", 0.97)}) == [("214", pytest.approx(0.97))]
    assert passage.see({104: reading("214")}, times=20) == []


def test_a_sign_that_was_reported_is_not_read_again(passage):
    passage.see({100: reading("214")}, times=20)
    assert passage.reads == 2


def test_it_is_reported_with_its_best_reading(passage):
    passage.see({100: reading("214", 0.99)})
    assert passage.see({100: reading("214", 0.7)}) == [("214", pytest.approx(0.99))]


def test_a_sign_that_left_and_returns_is_reported_again(passage):
    passage.see({100: reading("214")}, times=3)
    assert passage.see({}, times=6) == []
    assert passage.see({100: reading("214")}, times=2) == [("214", pytest.approx(0.95))]


def test_a_sign_that_flickers_stays_the_same(passage):
    passage.see({100: reading("214")}, times=2)
    for _ in range(5):
        assert passage.see({}, times=2) == []
        assert passage.see({100: reading("214")}) == []


def test_a_starved_task_that_sees_it_every_three_seconds_reports_it_once(passage):
    reported = passage.see({100: reading("214")}, times=6, after=3)
    assert reported == [("214", pytest.approx(0.95))]


def test_a_sign_that_jumps_is_known_by_its_text(passage):
    passage.see({100: reading("214")}, times=2)
    assert passage.see({400: reading("214")}, times=3) == []


def test_another_sign_at_the_place_of_the_last_is_reported(passage):
    passage.see({100: reading("214")}, times=2)
    assert passage.see({130: reading("216")}, times=2) == [("216", pytest.approx(0.95))]


def test_another_sign_long_after_one_that_was_read_once_is_no_reading_of_that_one(passage):
    passage.see({100: reading("509")})
    passage.see({}, after=5)
    assert passage.see({100: reading("511")}, after=1) == [("509", pytest.approx(0.95))]
    assert passage.see({100: reading("511")}, after=1) == [("511", pytest.approx(0.95))]


def test_a_blurred_reading_of_the_same_sign_after_a_gap_does_not_make_two(passage):
    passage.see({100: reading("509")})
    assert passage.see({100: reading("599", 0.7)}, after=3) == []
    assert passage.see({100: reading("509")}) == [("509", pytest.approx(0.95))]
    assert passage.see({}, times=6) == []


def test_two_signs_in_a_picture_are_both_reported(passage):
    assert passage.see({100: reading("12"), 300: reading("14")}, times=2) == [
        ("12", pytest.approx(0.95)),
        ("14", pytest.approx(0.95)),
    ]


def test_the_majority_decides(passage):
    reported = []
    for text in ("271", "214", "214"):
        reported += passage.see({100: reading(text)})
    assert reported == [("214", pytest.approx(0.95))]


def test_a_doubtful_sign_is_reported_when_it_leaves(passage):
    passage.see({100: reading("214", 0.7)}, times=4)
    assert passage.see({}, times=6) == [("214", pytest.approx(0.7))]


def test_a_guess_is_never_reported(passage):
    passage.see({100: reading("214", 0.4)}, times=4)
    assert passage.see({}, times=6) == []


def test_a_text_without_a_number_is_given_up(passage):
    assert passage.see({100: reading("EXIT")}, times=20) == []
    assert passage.reads == 4
    assert passage.tracker.is_settled


def test_a_text_that_was_unreadable_is_read_when_it_is_nearer(passage):
    passage.see({100: reading("")}, times=5)
    corners = at(90, 90, 90, 45)
    for _ in range(2):
        passage.time += 0.5
        reported = passage.tracker.follow([corners], round(passage.time * SECOND), lambda _: reading("214"))
    assert [sign.text for sign in reported] == ["214"]


@pytest.mark.parametrize("text", ["7", "214", "12345", "B12", "3.07", "17a", "12-14", "A-101"])
def test_numbers(text):
    assert NUMBER.fullmatch(text)


@pytest.mark.parametrize("text", ["", "EXIT", "123456", "1.2.3", "ROOM214", "a", "12ab"])
def test_invalid_numbers(text):
    assert NUMBER.fullmatch(text) is None
