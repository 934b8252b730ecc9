"""How well a task keeps up, for `robot/<task>/health` once a second, so a policy can react: `slam.misses > 0.1`."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotkit.cgroup import Throttling

EVERY_S = 1.0
WINDOW = 5
"""Messages that a window spans: a starved task shows after one second, and for five."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Counters since the start. `time` and `cpu` are in ns; `latency` is the sum over all samples done, in ns."""

    time: int
    cpu: int
    done: int = 0
    missed: int = 0
    dropped: int = 0
    broken: int = 0
    failures: int = 0
    latency: int = 0
    throttling: Throttling | None = None


@dataclass(frozen=True, slots=True)
class Queue:
    """Samples not done yet: how many, how many of those are past their deadline, and the age of the oldest in ns."""

    length: int = 0
    overdue: int = 0
    age: int = 0


class Health:
    """Compares the newest counters with those of some seconds ago. Pure: time comes with the snapshots."""

    def __init__(self, first: Snapshot) -> None:
        self._snapshots = deque([first], maxlen=WINDOW)

    def forget(self, now: Snapshot) -> None:
        """Start a new window: what came before a suspension says nothing about what comes after it."""
        self._snapshots = deque([now], maxlen=WINDOW)

    def message(self, now: Snapshot, queue: Queue, *, suspended: bool) -> dict[str, object]:
        """The health message over the current window, as JSON fields."""
        then = self._snapshots[0]
        self._snapshots.append(now)
        seconds = max(now.time - then.time, 1) / 1e9
        done = now.done - then.done
        dropped, broken = now.dropped - then.dropped, now.broken - then.broken
        late = now.missed - then.missed + dropped + queue.overdue
        due = done + dropped + broken + queue.overdue
        return {
            "misses": round(late / due, 4) if due else 0.0,
            "queue": queue.length,
            "waiting": round(max(queue.age, 0) / 1e9, 3),
            "throttled": _throttled(then.throttling, now.throttling),
            "rate": round(done / seconds, 3),
            "latency": round((now.latency - then.latency) / done / 1e9, 6) if done else None,
            "cpu": round((now.cpu - then.cpu) / 1e9 / seconds, 4),
            "dropped": dropped,
            "broken": broken,
            "failures": now.failures - then.failures,
            "suspended": suspended,
            "window": round(seconds, 3),
        }


def _throttled(then: Throttling | None, now: Throttling | None) -> float | None:
    """Fraction of the periods in which the task was throttled; None where the kernel does not report it."""
    if then is None or now is None:
        return None
    periods = now.periods - then.periods
    return round((now.throttled - then.throttled) / periods, 4) if periods > 0 else 0.0
