"""A node as a server of work, in virtual time: how long inputs wait and take. The model in five sentences.

Work arrives and waits in its task's queue; a full queue drops its oldest. A task works on one input at a time. At each
instant, the tasks that have work divide the node's cores by their weight, none faster than its threads allow. A task
with a quota stops for the rest of the period when it has used its quota up, as CFS bandwidth control does. What a task
does besides (bus, health) is taken off its quota and off the node.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

EPSILON = 1e-8
"""Seconds of CPU below which work is done and a quota is used up: a float resolves them for 10^7 s."""
SAME_PERIOD = 1e-6
"""Part of a period by which a boundary may be missed through rounding."""
LEAST = 0.001
"""Cores that remain for inputs where the background takes all: a task that stands still would never end."""


class Work(NamedTuple):
    """One input of a task: `input` numbers its queues, `cpu` is in seconds, and so is `transit`, before it arrived."""

    at: float
    task: str
    input: int
    cpu: float
    transit: float = 0.0

    def response(self, now: float) -> float:
        """Seconds since its source sent it."""
        return now - self.at + self.transit


class Allowance(NamedTuple):
    """What a task may use from now on: its part among those that compete, and a quota in cores if it has one."""

    weight: float
    quota: float | None = None
    suspended: bool = False


class Change(NamedTuple):
    """New allowances, in force from `at` on."""

    at: float
    allowances: Mapping[str, Allowance]


class Fate(StrEnum):
    """What became of an input."""

    DONE = "done"
    DROPPED = "dropped"
    SUSPENDED = "suspended"
    UNFINISHED = "unfinished"


class Outcome(NamedTuple):
    """An input's fate; `response` is from its source to its result, or for an unfinished one to the end."""

    work: Work
    fate: Fate
    response: float
    queue: int
    """How many inputs of the task waited when it arrived."""
    phase: int = 0
    """In which run of several, that differ in when the periods begin."""


class Served(NamedTuple):
    """A stretch in which the node used `cores` in all."""

    start: float
    end: float
    cores: float


@dataclass(slots=True)
class Worker:
    """One task: `depths` of its queues, `threads` that one input can use, `background` in cores."""

    depths: Sequence[int]
    threads: float = 1.0
    background: float = 0.0
    allowance: Allowance = field(default_factory=lambda: Allowance(1.0))
    left: float = math.inf
    """CPU seconds that the quota still allows in this period."""
    waiting: deque[tuple[Work, int]] = field(default_factory=deque)
    current: tuple[Work, int] | None = None
    remaining: float = 0.0

    @property
    def runs(self) -> bool:
        """Whether it competes for the CPU now."""
        return self.current is not None and self.left > EPSILON

    def refill(self, period: float) -> None:
        """Begin a period, or get a new quota: the kernel refills at once."""
        quota = self.allowance.quota
        self.left = math.inf if quota is None else max(quota - self.background, LEAST) * period

    def next(self) -> None:
        """Take the input that arrived first."""
        self.current = self.waiting.popleft() if self.waiting else None
        self.remaining = self.current[0].cpu if self.current else 0.0


@dataclass(slots=True)
class Server:
    """One node; `serve` runs it once, from 0 to the end. The first period began `offset` seconds before 0."""

    cores: float
    workers: dict[str, Worker]
    period: float
    offset: float = 0.0
    outcomes: list[Outcome] = field(default_factory=list)
    used: list[Served] = field(default_factory=list)
    now: float = 0.0
    _periods: int = -1
    """Number of the period for which quotas were refilled last."""

    def serve(self, arrivals: Iterable[Work], changes: Sequence[Change], until: float) -> None:
        """Serve the arrivals (in order of time) under the changes (likewise) up to `until`."""
        works, turns = deque(arrivals), deque(changes)
        while self.now < until:
            while turns and turns[0].at <= self.now + EPSILON:
                self._change(turns.popleft())
            while works and works[0].at <= self.now + EPSILON:
                self._arrive(works.popleft())
            self._advance(min([until, *(due[0].at for due in (works, turns) if due)]))
        for worker in self.workers.values():
            for work, queue in ([worker.current] if worker.current else []) + list(worker.waiting):
                self.outcomes.append(Outcome(work, Fate.UNFINISHED, work.response(until), queue))

    def _advance(self, until: float) -> None:
        """Let the workers run to the next moment at which anything changes, `until` at the latest."""
        self._begin_period()
        rates = self._rates()
        if any(worker.current and worker.allowance.quota is not None for worker in self.workers.values()):
            until = min(until, (self._periods + 1) * self.period - self.offset)
        for name, rate in rates.items():
            worker = self.workers[name]
            until = min(until, self.now + min(worker.remaining, worker.left) / rate)
        passed = until - self.now
        if passed > 0:
            self.used.append(Served(self.now, until, sum(rates.values())))
        self.now = until
        for name, rate in rates.items():
            self._work(self.workers[name], rate * passed)

    def _begin_period(self) -> None:
        """Refill all quotas if a period has begun: the kernel's timer has one grid for all."""
        current = math.floor((self.now + self.offset) / self.period + SAME_PERIOD)
        if current != self._periods:
            self._periods = current
            for worker in self.workers.values():
                worker.refill(self.period)

    def _work(self, worker: Worker, cpu: float) -> None:
        worker.remaining -= cpu
        worker.left -= cpu
        if worker.remaining <= EPSILON and worker.current is not None:
            work, queue = worker.current
            self.outcomes.append(Outcome(work, Fate.DONE, work.response(self.now), queue))
            worker.next()

    def _rates(self) -> dict[str, float]:
        """Cores of each task that runs: the node divided by weight, and what one can't use goes to the others."""
        rates: dict[str, float] = {}
        open_ = {name: worker for name, worker in self.workers.items() if worker.runs}
        left = max(self.cores - sum(worker.background for worker in self.workers.values()), LEAST)
        while open_:
            total = sum(worker.allowance.weight for worker in open_.values())
            parts = {name: left * worker.allowance.weight / total for name, worker in open_.items()}
            full = [name for name, worker in open_.items() if parts[name] >= worker.threads]
            if not full:
                return rates | parts
            for name in full:
                rates[name] = open_.pop(name).threads
                left -= rates[name]
        return rates

    def _change(self, change: Change) -> None:
        for name, allowance in change.allowances.items():
            worker = self.workers[name]
            if allowance != worker.allowance:
                worker.allowance = allowance
                worker.refill(self.period)
            if allowance.suspended:
                self.outcomes += [Outcome(work, Fate.SUSPENDED, 0.0, queue) for work, queue in worker.waiting]
                worker.waiting.clear()

    def _arrive(self, work: Work) -> None:
        worker = self.workers[work.task]
        if worker.allowance.suspended:
            self.outcomes.append(Outcome(work, Fate.SUSPENDED, 0.0, 0))
            return
        own = [item for item in worker.waiting if item[0].input == work.input]
        if len(own) >= worker.depths[work.input]:
            worker.waiting.remove(own[0])
            self.outcomes.append(Outcome(own[0][0], Fate.DROPPED, own[0][0].response(self.now), own[0][1]))
        worker.waiting.append((work, len(worker.waiting)))
        if worker.current is None:
            worker.next()
