from __future__ import annotations

import threading
from itertools import cycle
from unittest.mock import MagicMock

import pytest

from modules.navigation import task
from modules.navigation.create2 import STREAMED
from modules.navigation.packets import Frame
from modules.navigation.task import Navigation
from tests.modules.navigation.test_late_samples import ROUTE, received


def a_line():
    """A robot's line on which there is always one frame to read."""
    frame = Frame(STREAMED).encode(dict.fromkeys(STREAMED, 0))
    line = MagicMock(read=MagicMock(side_effect=cycle([frame, b""])))
    line.__enter__.return_value = line
    return line


@pytest.fixture(autouse=True)
def _at_once(monkeypatch):
    monkeypatch.setattr(task, "CYCLE_S", 0.0)


def test_a_connection_that_takes_longer_than_a_suspension_leaves_the_next_one_its_robot(monkeypatch):
    navigation, slow, ended = Navigation("/dev/robot"), a_line(), threading.Event()
    resumed = navigation.produce(threading.Event())

    def connect(_port, _baud):
        if ended.is_set():
            return a_line()
        ended.set()
        next(resumed)
        return slow

    monkeypatch.setattr(task, "open_line", connect)
    assert list(navigation.produce(ended)) == []
    assert not slow.write.called
    navigation.process(received("order", ROUTE))
    assert navigation._pilot.wanted
    resumed.close()


def test_a_thread_that_ends_late_leaves_the_next_one_its_robot(monkeypatch):
    monkeypatch.setattr(task, "open_line", lambda *_: a_line())
    navigation = Navigation("/dev/robot")
    before, after = navigation.produce(threading.Event()), navigation.produce(threading.Event())
    next(before)
    next(after)
    navigation.process(received("order", ROUTE))
    before.close()
    assert navigation._pilot.wanted
    after.close()
    assert navigation._robot is None
