"""Static weights without a machine: a small model of Linux's fair scheduler (EEVDF), fast enough for a search. Pure.

Each processor has its own queue. The task to run is the one with the earliest virtual deadline among those that have
had no more than their part (virtual time at most the weighted mean). It runs until it is done or has used a slice, or
until a task wakes with an earlier deadline. A task wakes on an idle processor, else on the one with the least weight;
a processor that becomes idle takes the lightest task that waits elsewhere. Not modelled: periodic balancing, the cost
of switching, wake-ups from other groups, lag that is kept over a sleep. So the search's best are run for real before
one of them is chosen.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from tests.bench.enforcement.inputs import EARLY
from tests.bench.enforcement.stories import PROCESSORS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tests.bench.enforcement.inputs import Inputs

SLICE = 0.004
"""Seconds: the kernel's base slice is shorter, but ends are noticed at ticks, 250 a second."""
BEFORE = -1.0
"""A time before the first input."""


@dataclass(slots=True, eq=False)
class Simulated:
    """One task: what it takes, what an input costs, and its weight."""

    inputs: Inputs
    cost: float
    weight: float
    last: int = -1
    left: float = 0.0
    virtual: float = 0.0
    deadline: float = 0.0
    finished: list[float] = field(init=False)

    def __post_init__(self) -> None:
        self.finished = [math.nan] * self.inputs.count

    def take(self, now: float) -> bool:
        """Begin the next input, if there is one."""
        number = self.inputs.next(self.last, now)
        if number is None:
            return False
        self.last, self.left = number, self.cost
        return True


class Processor:
    """One processor's queue, the running task included."""

    def __init__(self) -> None:
        self.queue: list[Simulated] = []
        self.current: Simulated | None = None

    @property
    def weight(self) -> float:
        return sum(task.weight for task in self.queue)

    @property
    def next(self) -> float:
        """Seconds until the running task is done or its slice over."""
        task = self.current
        return math.inf if task is None else min(task.left, (task.deadline - task.virtual) * task.weight)

    def run(self, seconds: float) -> None:
        if self.current is not None:
            self.current.left -= seconds
            self.current.virtual += seconds / self.current.weight

    def add(self, task: Simulated) -> None:
        task.virtual = self._mean()
        task.deadline = task.virtual + SLICE / task.weight
        self.queue.append(task)
        if self.current is None or task.deadline < self.current.deadline:
            self.current = task

    def remove(self, task: Simulated) -> None:
        self.queue.remove(task)
        if self.current is task:
            self.choose()

    def choose(self) -> None:
        """Whose turn it is."""
        mean = self._mean() + EARLY
        eligible = [task for task in self.queue if task.virtual <= mean]
        self.current = min(eligible, key=_deadline, default=None)

    def renew(self, task: Simulated) -> None:
        """The running task has used its slice."""
        task.deadline = task.virtual + SLICE / task.weight
        self.choose()

    def waiting(self) -> list[Simulated]:
        return [task for task in self.queue if task is not self.current]

    def _mean(self) -> float:
        weight = self.weight
        return sum(task.virtual * task.weight for task in self.queue) / weight if weight else 0.0


def simulate(tasks: Mapping[str, Simulated], until: float) -> dict[str, list[float]]:
    """When each input of each task is done (NaN: never)."""
    _Simulation(list(tasks.values()), until).run()
    return {name: task.finished for name, task in tasks.items()}


class _Simulation:
    def __init__(self, tasks: list[Simulated], until: float) -> None:
        self._tasks, self._until, self._now = tasks, until, 0.0
        self._processors = [Processor() for _ in range(PROCESSORS)]
        self._wakes: list[tuple[float, int]] = []
        for place in range(len(tasks)):
            self._sleep(place, BEFORE)

    def run(self) -> None:
        while True:
            soonest = min(processor.next for processor in self._processors)
            wake = self._wakes[0][0] if self._wakes else math.inf
            moment = min(self._now + soonest, wake)
            if moment > self._until:
                return
            for processor in self._processors:
                processor.run(moment - self._now)
            self._now = moment
            for processor in self._processors:
                self._settle(processor)
            self._wake()

    def _settle(self, processor: Processor) -> None:
        task = processor.current
        if task is None or processor.next > EARLY:
            return
        if task.left > EARLY:
            processor.renew(task)
            return
        task.finished[task.last] = self._now
        if task.take(self._now):
            processor.choose()
            return
        processor.remove(task)
        self._sleep(self._tasks.index(task), self._now)
        if processor.current is None:
            self._pull(processor)

    def _pull(self, idle: Processor) -> None:
        waiting = [(task.weight, place, task) for place, p in enumerate(self._processors) for task in p.waiting()]
        if waiting:
            _, place, task = min(waiting, key=lambda found: found[:2])
            self._processors[place].remove(task)
            idle.add(task)

    def _sleep(self, place: int, now: float) -> None:
        task = self._tasks[place]
        wake = task.inputs.wake(task.last, now)
        if wake is not None:
            heapq.heappush(self._wakes, (wake, place))

    def _wake(self) -> None:
        while self._wakes and self._wakes[0][0] <= self._now + EARLY:
            _, place = heapq.heappop(self._wakes)
            task = self._tasks[place]
            if task.take(self._now):
                min(self._processors, key=lambda processor: processor.weight).add(task)
            else:
                self._sleep(place, self._now)


def _deadline(task: Simulated) -> float:
    return task.deadline
