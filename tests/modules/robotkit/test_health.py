from __future__ import annotations

import pytest

from robotkit.cgroup import Throttling
from robotkit.health import WINDOW, Health, Queue, Snapshot

S = 1_000_000_000
IDLE = Queue()


def after(*snapshots, queue=IDLE, suspended=False):
    health = Health(snapshots[0])
    messages = [health.message(snapshot, queue, suspended=suspended) for snapshot in snapshots[1:]]
    return messages[-1]


def test_an_idle_task_has_no_misses():
    message = after(Snapshot(0, 0), Snapshot(S, S // 100))
    assert (message["misses"], message["latency"], message["rate"], message["cpu"]) == (0.0, None, 0.0, 0.01)


def test_late_dropped_and_overdue_inputs_are_misses():
    now = Snapshot(S, S // 2, done=6, missed=1, dropped=2, latency=6 * S // 10)
    message = after(Snapshot(0, 0), now, queue=Queue(length=2, overdue=2))
    assert message["misses"] == 0.5  # (1 late + 2 dropped + 2 overdue) of (6 done + 2 dropped + 2 overdue)
    assert (message["queue"], message["dropped"], message["latency"], message["rate"]) == (2, 2, 0.1, 6.0)


def test_a_task_that_never_ends_its_first_input_misses():
    message = after(Snapshot(0, 0), Snapshot(S, 0), queue=Queue(length=1, overdue=1))
    assert message["misses"] == 1.0


def test_the_age_of_the_queue_is_that_of_its_oldest():
    message = after(Snapshot(0, 0), Snapshot(S, 0), queue=Queue(length=3, age=S // 4))
    assert (message["queue"], message["waiting"]) == (3, 0.25)


def test_a_broken_sample_is_not_a_miss():
    message = after(Snapshot(0, 0), Snapshot(S, 0, broken=3, failures=1))
    assert (message["misses"], message["broken"], message["failures"]) == (0.0, 3, 1)


def test_misses_before_the_window_are_forgotten():
    bad = [Snapshot(second * S, 0, done=10 * second, missed=10 if second else 0) for second in range(WINDOW + 1)]
    assert after(*bad)["misses"] == 0.2
    later = Snapshot((WINDOW + 1) * S, 0, done=10 * (WINDOW + 1), missed=10)
    message = after(*bad, later)
    assert (message["misses"], message["window"]) == (0.0, float(WINDOW))


def test_after_a_suspension_the_window_starts_afresh():
    health = Health(Snapshot(0, 0))
    health.forget(Snapshot(10 * S, 0, done=10, missed=10))
    message = health.message(Snapshot(11 * S, 0, done=20, missed=10), Queue(), suspended=False)
    assert (message["misses"], message["window"]) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("then", "now", "expected"),
    [
        (Throttling(100, 10), Throttling(110, 15), 0.5),
        (Throttling(100, 10), Throttling(100, 10), 0.0),
        (None, Throttling(1, 1), None),
        (Throttling(1, 1), None, None),
    ],
)
def test_throttling(then, now, expected):
    message = after(Snapshot(0, 0, throttling=then), Snapshot(S, 0, throttling=now), suspended=True)
    assert (message["throttled"], message["suspended"]) == (expected, True)
