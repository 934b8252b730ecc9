"""Thresholds from recordings: the highest that hear most."""

from __future__ import annotations

import pytest

from modules.speech.keywords import KEYWORDS
from modules.speech.listener import Heard
from modules.speech.tuning import HIGHEST, LOWEST, Evidence


def heard(keyword, evidence, at=0.0):
    return Heard(keyword, at, at + 0.4, evidence)


@pytest.fixture
def evidence():
    counted = Evidence()
    counted.count("left", [heard("left", 2.0), heard("left", 3.0), heard("stop", 9.0)], 1)
    counted.count("left", [heard("right", 4.0)], 1)
    counted.count("lift", [heard("left", 7.0)], 60)  # clips of other words are no connected speech
    counted.count(None, [heard("left", 2.5)], 60)
    counted.count(None, [heard("left", 1.0, at=90), heard("left", 1.5, at=95)], 540)
    return counted


def test_the_threshold_is_the_highest_with_which_nine_of_ten_clips_are_heard():
    counted = Evidence()
    for least in (1.7, *[3.0] * 8, 0.2):
        counted.count("left", [heard("left", least)], 1)
    assert counted.threshold("left") == 1.5
    assert counted.heard("left", 1.5) == 9
    assert counted.heard("left", 2.0) == 8


def test_a_rarely_heard_command_gets_the_lowest_threshold(evidence):
    assert evidence.threshold("left") == LOWEST
    assert heard("left", LOWEST).confidence == 0.5


def test_a_reliably_heard_command_gets_the_highest_threshold():
    counted = Evidence()
    counted.count("stop", [heard("stop", 20.0)], 1)
    assert counted.threshold("stop") == HIGHEST


def test_a_false_alarm_in_overlapping_pieces_counts_once():
    counted = Evidence()
    counted.count(None, [heard("left", 2.0, at=1.5), heard("left", 3.0, at=1.6), heard("left", 2.0, at=2.2)], 60)
    assert counted.rate("left", 1.0) == 2
    assert counted.rate("left", 2.5) == 1


def test_the_report_says_what_each_choice_means(evidence):
    first, *lines = evidence.report().splitlines()
    assert first == "10.0 minutes without commands"
    assert len(lines) == len(KEYWORDS)
    assert "left: at 0.0 1 of 2 heard, 0.30 a minute invented" in evidence.report()
