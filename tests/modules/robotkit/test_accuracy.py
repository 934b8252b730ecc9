from __future__ import annotations

import pytest

from robotkit.accuracy import Confusion, Event, Matched, match_events


def test_a_confusion_table():
    confusion = Confusion()
    for truth, reported in [("still", "still")] * 3 + [("still", "moving")] + [("moving", "moving")] * 4:
        confusion.add(truth, reported)
    assert confusion.accuracy == 7 / 8
    assert confusion.recall("still") == 0.75
    assert confusion.table().splitlines() == [
        "| truth \\ predicted | moving | still | recall |",
        "| --- | --- | --- | --- |",
        "| **moving** | 4 | 0 | 100.0% |",
        "| **still** | 1 | 3 | 75.0% |",
    ]


def test_an_empty_table_has_no_accuracy():
    assert (Confusion().accuracy, Confusion().recall("x")) == (0, 0)


def test_events_match_once_within_their_window():
    truth = [Event(1, "stop"), Event(2, "left"), Event(3, "stop")]
    reported = [Event(1.2, "stop"), Event(1.3, "stop"), Event(2.9, "left"), Event(3.4, "stop")]
    matched = match_events(truth, reported, early=0.1, late=0.5)
    assert matched == Matched(found=2, missed=1, invented=2)
    assert matched.recall == pytest.approx(2 / 3)


def test_an_early_answer_is_another_event():
    assert match_events([Event(1, "stop")], [Event(0.5, "stop")], early=0.1, late=1) == Matched(0, 1, 1)
