from __future__ import annotations

from collections import deque
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, cast

import pytest

from modules.lidar import rplidar, scanner
from modules.lidar.scan import BINS
from modules.lidar.scan_modes import EXPRESS, STANDARD
from modules.lidar.scanner import LATE_S, Scanner
from modules.lidar.simulator import TURNS_PER_SECOND, RplidarA1
from modules.lidar.task import Lidar

START = 1_795_362_405_000_000_000
ROUNDS = 60


class World:
    """A lidar in virtual time, which passes while its reader waits; `pauses` has the seconds of some of the rounds."""

    name = "a line"

    def __init__(self, mode):
        self.lidar = RplidarA1(lambda _: 1.0)
        self.lidar.receive(rplidar.EXPRESS_SCAN if mode == "express" else rplidar.SCAN)
        self.passed, self.rounds, self.pauses = 0.0, 0, {}
        self.scanner = Scanner(cast("Any", self), mode)
        self._arrived: deque[bytes] = deque()

    def wait(self, seconds):
        self.rounds += 1
        for _ in range(round(self.pauses.get(self.rounds, seconds) / 0.01)):
            self.passed += 0.01
            self._arrived.append(self.lidar.advance(0.01))
        return self.rounds == ROUNDS

    def read(self, _timeout):
        """Like a serial line: as much as a reading holds."""
        data = b""
        while self._arrived and len(data) + len(self._arrived[0]) <= 4096:
            data += self._arrived.popleft()
        return data

    def turns(self):
        return list(self.scanner.turns(cast("Any", self)))


@pytest.fixture
def world(monkeypatch):
    """Makes one for a mode."""

    def made(mode="standard"):
        world = World(mode)
        now = SimpleNamespace(monotonic=lambda: world.passed, time_ns=lambda: START + round(world.passed * 1e9))
        monkeypatch.setattr(scanner, "time", now)
        return world

    return made


@pytest.mark.parametrize(("mode", "exact"), [(STANDARD, 0.002), (EXPRESS, 0.009)])
def test_a_turn_ended_when_its_last_sample_was_measured(world, mode, exact):
    """A capsule of express data takes 8 ms."""
    turns = world(mode.name.lower()).turns()
    assert len(turns) > 10
    for number, turn in enumerate(turns, 1):
        turned = 360 * number + (turn.nodes[-1].angle + 180) % 360 - 180
        assert (turn.ended - START) / 1e9 == pytest.approx(turned / 360 / TURNS_PER_SECOND, abs=exact)
        assert turn.took / 1e9 == pytest.approx(1 / TURNS_PER_SECOND, rel=0.01)


def test_stamp_and_time_increment_say_when_each_ray_was_measured(world):
    turn = world().turns()[3]
    scan = Lidar()._scan(turn)
    assert scan["scan_time"] == turn.took / 1e9
    sample = 1 / STANDARD.rate
    for before_the_last, node in enumerate(reversed(turn.nodes)):
        ray = round(-node.angle) % BINS
        assert ray * scan["time_increment"] == pytest.approx(-before_the_last * sample, abs=2 * sample)


def test_what_waited_during_a_pause_is_discarded(world):
    paused = world()
    paused.pauses = {20: 5.0}
    turns = paused.turns()
    begins = [(turn.ended - turn.took - START) / 1e9 for turn in turns]
    assert [begin for begin in begins if 1.0 < begin < 5.9] == []
    assert begins[-1] > 6
    assert paused.scanner.lost == 1


def test_after_a_short_pause_the_turn_goes_on(world):
    paused = world()
    paused.pauses = {20: LATE_S - 0.05}
    ends = [turn.ended for turn in paused.turns()]
    assert {round((after - before) / 1e8) for before, after in pairwise(ends)} == {2}
    assert paused.scanner.lost == 0
