"""Thresholds from recordings: the lowest that invents little."""

from __future__ import annotations

import pytest

from modules.speech.evaluation import HALVES, in_half
from modules.speech.listener import Heard
from modules.speech.spotter import KEYWORDS
from modules.speech.tuning import GOAL, HIGHEST, LOWEST, Evidence


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


def test_the_threshold_is_the_lowest_that_keeps_to_the_goal(evidence):
    assert evidence.threshold("left") == 1.6
    assert evidence.rate("left", 1.5) > GOAL >= evidence.rate("left", 1.6)


def test_a_command_that_nothing_resembles_needs_no_evidence(evidence):
    assert evidence.threshold("forward") == LOWEST


def test_a_threshold_may_be_below_zero():
    """Evidence is a log-odds: of 1241 clips, half of those of left have less than 0.6."""
    counted = Evidence()
    counted.count(None, [heard("left", -2.0, at=second) for second in range(10)], 60)
    assert counted.threshold("left") == -1.9


def test_what_is_always_invented_needs_the_most():
    counted = Evidence()
    counted.count(None, [heard("stop", 20.0, at=second) for second in range(10)], 60)
    assert counted.threshold("stop") == HIGHEST


def test_what_two_overlapping_pieces_of_speech_hold_is_invented_once():
    counted = Evidence()
    counted.count(None, [heard("left", 2.0, at=1.5), heard("left", 3.0, at=1.6), heard("left", 2.0, at=2.2)], 60)
    assert counted.rate("left", 1.0) == 2
    assert counted.rate("left", 2.5) == 1


def test_the_report_says_what_each_choice_means(evidence):
    first, *lines = evidence.report().splitlines()
    assert first == "10.0 minutes without commands"
    assert len(lines) == len(KEYWORDS)
    assert "left: at 1.6 1 of 2 heard, 0.10 a minute invented; at 1.1 1 of 2 heard, 0.20" in evidence.report()


def test_a_speaker_is_in_one_half():
    speakers = [str(number) for number in range(100)]
    halves = [[speaker for speaker in speakers if in_half(speaker, half)] for half in HALVES]
    assert sorted(halves[0] + halves[1], key=int) == speakers
    assert min(map(len, halves)) > 30
    assert all(in_half(speaker, None) for speaker in speakers)
