import os
import socket

import pytest

from tests.soak import growth
from tests.soak.growth import MIB, Size


def life(pid=1, hours=1.0, threads=lambda _: 20, sockets=lambda _: 10, memory=lambda _: 90.0):
    """A process that is looked at each minute; what it has depends on the part of the time that has passed."""
    moments = [minute / (60 * hours) for minute in range(int(60 * hours))]
    return [Size(part * hours * 3600, pid, threads(part), sockets(part), round(memory(part) * MIB)) for part in moments]


def test_constant_sizes_are_not_a_leak():
    assert growth.leaks("operator", life()) == []
    assert growth.slope(life()) == pytest.approx(0)


@pytest.mark.parametrize(
    ("grown", "words"),
    [
        ({"threads": lambda part: 20 + int(part * 10)}, "threads went from 20 to 29"),
        ({"sockets": lambda part: 10 + int(part * 100)}, "sockets went from 1"),
        ({"memory": lambda part: 90 + part * 20}, "memory went from"),
    ],
)
def test_steady_growth_is_a_leak(grown, words):
    [reported] = growth.leaks("operator", life(**grown))
    assert words in reported


def test_one_moment_is_not_a_leak():
    assert growth.leaks("operator", life(sockets=lambda part: 100 if part == 0.5 else 10)) == []


def test_connections_that_are_kept_are_not_a_leak():
    assert growth.leaks("operator", life(hours=0.02, sockets=lambda part: 14 if part < 0.4 else 18)) == []


def test_the_slope_is_in_mebibytes_an_hour():
    assert growth.slope(life(memory=lambda part: 90 + 6 * part)) == pytest.approx(6, rel=0.01)


def test_only_the_settled_part_of_the_last_process_counts():
    sizes = [*life(pid=1), *(Size(3600 + 10 * n, 2, 20, 10, 90 * MIB) for n in range(7))]
    own = growth.last_life(sizes)
    assert {size.pid for size in own} == {2}
    assert own[0].at == 3630
    assert growth.last_life([]) == []


def test_a_flight_recorder_that_fills_is_not_a_leak():
    """As seen in the first minutes of a soak."""
    filling = life(hours=0.5, memory=lambda part: min(113.0, 98 + part * 1800 * 0.05))
    assert growth.leaks("operator", growth.last_life(filling)) == []


def test_a_process_that_lived_too_briefly_is_reported():
    assert growth.reported("router", []) == "router: lived too briefly to judge"
    assert growth.leaks("router", []) == []


def test_the_line_shows_what_was_measured():
    assert growth.reported("operator", life()) == (
        "operator: 3540 s, threads 20 -> 20, sockets 10 -> 10, memory 90.0 -> 90.0 MiB, +0.0 MiB an hour"
    )


def test_this_very_process_can_be_read():
    before = Size.of(os.getpid(), 0.0)
    with socket.socket():
        assert Size.of(os.getpid(), 0.0).sockets == before.sockets + 1
    assert before.threads >= 1
    assert before.memory > MIB
