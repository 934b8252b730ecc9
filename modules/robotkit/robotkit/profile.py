"""What a task costs: CPU, waiting time and latency of each input, as counts since the start and as distributions.

Experiments compare profiles, and misses are predicted from them; docs/reference/robotkit.md has the format.
"""

from __future__ import annotations

import math
import os
import platform
import time
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from robotkit.module import Module

KEPT = 4096
"""How many of the newest runs the distributions cover."""
STEPS = 20
"""Quantiles go from 0 to 1 in this many steps."""
PLAUSIBLE_NS = 60_000_000_000
"""A stamp further from the arrival than this was made by another clock."""


class Run(NamedTuple):
    """One sample from its source to its result; times are in ns since 1970, `cpu` is in ns."""

    stamp: int
    received: int
    started: int
    finished: int
    cpu: int

    @property
    def latency(self) -> int:
        """Time from the source to the result in ns; from the arrival where the source has another clock."""
        known = 0 <= self.received - self.stamp <= PLAUSIBLE_NS
        return self.finished - (self.stamp if known else self.received)


class Record:
    """The runs of one input, or of what the task produces unasked; `deadline` is in seconds."""

    def __init__(self, deadline: float | None) -> None:
        self.done = self.missed = self.broken = self.latency = self.cpu = 0
        self._deadline = math.inf if deadline is None else deadline * 1e9
        self._runs: deque[Run] = deque(maxlen=KEPT)

    def add(self, run: Run) -> bool:
        """Count a run; returns whether it missed the deadline."""
        late = run.latency > self._deadline
        self._runs.append(run)
        self.done += 1
        self.missed += late
        self.latency += run.latency
        self.cpu += run.cpu
        return late

    def overdue(self, since: int, now: int) -> bool:
        """Whether an unfinished sample that arrived at `since` has already missed its deadline (both in ns)."""
        return now - since > self._deadline

    def as_json(self, dropped: int = 0, shared: int = 0) -> dict[str, object]:
        """Counts since the start, and the distribution of the newest runs in seconds."""
        runs = list(self._runs)
        return {
            "done": self.done,
            "missed": self.missed,
            "dropped": dropped,
            "broken": self.broken,
            "shared": shared,
            "cpu": distribution(run.cpu for run in runs),
            "wait": distribution(run.started - run.received for run in runs),
            "service": distribution(run.finished - run.started for run in runs),
            "latency": distribution(run.latency for run in runs),
        }


def distribution(nanoseconds: Iterable[int]) -> dict[str, object]:
    """Mean, standard deviation and quantiles in seconds; without values None, None and an empty list."""
    values = sorted(value / 1e9 for value in nanoseconds)
    if not values:
        return {"mean": None, "std": None, "quantiles": []}
    mean = math.fsum(values) / len(values)
    spread = math.sqrt(math.fsum((value - mean) ** 2 for value in values) / len(values))
    return {
        "mean": round(mean, 9),
        "std": round(spread, 9),
        "quantiles": [round(values[round(step / STEPS * (len(values) - 1))], 9) for step in range(STEPS + 1)],
    }


class Profile:
    """All records of a task since it was started; `cpu` gives the CPU time that it has used, in ns."""

    def __init__(self, module: Module, cpu: Callable[[], int] = time.process_time_ns) -> None:
        self.inputs = {name: Record(module.needs.deadline) for name in module.inputs}
        self.produced = Record(module.needs.deadline)
        self.failures = 0
        self._module, self._cpu = module, cpu
        self._started = time.monotonic_ns()

    @property
    def records(self) -> tuple[Record, ...]:
        """The records of all inputs, and of what is produced."""
        return (*self.inputs.values(), self.produced)

    def as_json(self, task: str, dropped: Mapping[str, int], shared: Mapping[str, int]) -> dict[str, object]:
        """The profile document; `background` is the CPU in cores used outside the runs: bus, queues, health."""
        elapsed = max(time.monotonic_ns() - self._started, 1)
        total, runs = self._cpu(), sum(record.cpu for record in self.records)
        return {
            "task": task,
            "module": self._module.name,
            "machine": {"processor": processor(), "cores": os.cpu_count()},
            "deadline": self._module.needs.deadline,
            "seconds": round(elapsed / 1e9, 3),
            "background": round(max(total - runs, 0) / elapsed, 6),
            "failures": self.failures,
            "inputs": {
                name: {"key": own.key, "depth": own.depth, **self.inputs[name].as_json(dropped[name], shared[name])}
                for name, own in self._module.inputs.items()
            },
            "produced": self.produced.as_json(),
        }


def processor() -> str:
    """The CPU model if Linux reports it, else the architecture."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith(("model name", "Model"))]
    return models[0] if models else platform.machine()
