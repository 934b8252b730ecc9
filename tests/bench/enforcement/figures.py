"""What became of the inputs of a run, and of all runs of a cell together. Pure.

An input counts in the context in which it arrives, whatever becomes of it: one that is dropped, or never done, is a
miss, and has an infinite response time. Only what arrives while its context suspends its task is not due, under every
division alike.
"""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from tests.bench.enforcement.stories import Script, Story, Task

TENTHS = 10_000
"""Response times are kept in tenths of a millisecond."""


@dataclass(frozen=True, slots=True)
class Run:
    """One run of a cell: response times by task and context (None: never), and CPU seconds of work by task.

    `drain` are the seconds until nothing waited any more, None if that took too long. `late` is the latest write of a
    context's settings, `foreign` the CPU seconds that others took from the machine.
    """

    responses: Mapping[str, Mapping[str, Sequence[int | None]]]
    work: Mapping[str, float]
    drain: float | None
    late: float = 0.0
    foreign: float = 0.0

    @classmethod
    def of(  # noqa: PLR0913 - what there is to know of a run
        cls,
        tasks: Sequence[Task],
        script: Script,
        finished: Mapping[str, Sequence[float]],
        work: Mapping[str, float],
        drained: Iterable[str] | None,
        *,
        late: float = 0.0,
        foreign: float = 0.0,
    ) -> Run:
        """From when each input was done (NaN: never); `drained` are the tasks that had nothing left in the end."""
        responses = {task.name: _responses(task, script, finished[task.name]) for task in tasks}
        done = [time for name in drained or () for time in finished[name] if not math.isnan(time)]
        drain = None if drained is None else max(0.0, max(done, default=0.0) - script.end)
        rounded = {name: round(seconds, 4) for name, seconds in work.items()}
        return cls(responses, rounded, None if drain is None else round(drain, 4), round(late, 5), round(foreign, 3))

    def values(self) -> dict[str, Any]:
        """As plain data, which `Run(**values)` reads."""
        return {name: getattr(self, name) for name in ("responses", "work", "drain", "late", "foreign")}


def _responses(task: Task, script: Script, finished: Sequence[float]) -> dict[str, list[int | None]]:
    found: dict[str, list[int | None]] = {context.name: [] for context in script.story.contexts}
    for number, time in enumerate(finished):
        arrival = script.phase(task) + number / task.rate
        found[script.at(arrival).name].append(None if math.isnan(time) else round((time - arrival) * TENTHS))
    return found


@dataclass(frozen=True, slots=True)
class Figures:
    """All runs of one cell; `story` says whose inputs are due where.

    `blocks` are the runs' blocks, and `places` say when each was measured, by its place among all runs.
    """

    story: Story
    tasks: Mapping[str, Task]
    runs: Sequence[Run]
    blocks: Sequence[int] = ()
    places: Sequence[int] = ()

    def only(self, blocks: Sequence[int]) -> Figures:
        """The runs of these blocks, in their order."""
        found = [self.blocks.index(block) for block in blocks]
        places = [self.places[number] for number in found]
        return Figures(self.story, self.tasks, [self.runs[number] for number in found], blocks, places)

    def hit(self, task: str, contexts: Iterable[str] | None = None) -> float:
        """Of the task's inputs due in these contexts (all), the part that was done in time; NaN if none was due."""
        return self._rate(task, self.runs, contexts)

    def hits(self, task: str, contexts: Iterable[str] | None = None) -> list[float]:
        """The same, block by block."""
        return [self._rate(task, [run], contexts) for run in self.runs]

    def done(self, task: str, run: Run, contexts: Iterable[str] | None = None) -> tuple[int, int]:
        """Of the task's inputs due in a run in these contexts (all): how many were done in time, and their number."""
        due = self._due(task, [run], contexts)
        return self._in_time(task, due), len(due)

    def times(self, task: str, run: Run) -> list[float]:
        """How long each of the task's inputs due in a run took, in tenths of a millisecond; infinite without an end."""
        return [math.inf if one is None else one for one in self._due(task, [run], None)]

    def critical(self) -> dict[str, float]:
        """Each context's own task in it."""
        return {context.name: self.hit(context.critical, [context.name]) for context in self.story.contexts}

    def quantile(self, task: str, part: float) -> float:
        """Seconds within which that part of the task's due inputs was done; infinite if fewer ever were."""
        return _quantile([time for run in self.runs for time in self.times(task, run)], part)

    def quantiles(self, task: str, part: float) -> list[float]:
        """The same, block by block."""
        return [_quantile(self.times(task, run), part) for run in self.runs]

    @property
    def work(self) -> float:
        """CPU seconds of all tasks, the median over the blocks."""
        return statistics.median(sum(run.work.values()) for run in self.runs)

    @property
    def foreign(self) -> float:
        """CPU seconds that others took, the median over the blocks."""
        return statistics.median(run.foreign for run in self.runs)

    @property
    def drain(self) -> float | None:
        """Seconds until nothing waited, the median over the blocks; None if in most it took too long."""
        middle = statistics.median(math.inf if run.drain is None else run.drain for run in self.runs)
        return None if math.isinf(middle) else middle

    def _rate(self, task: str, runs: Sequence[Run], contexts: Iterable[str] | None) -> float:
        due = self._due(task, runs, contexts)
        return self._in_time(task, due) / len(due) if due else math.nan

    def _in_time(self, task: str, due: Sequence[int | None]) -> int:
        limit = self.tasks[task].deadline * TENTHS
        return sum(one is not None and one <= limit for one in due)

    def _due(self, task: str, runs: Sequence[Run], contexts: Iterable[str] | None) -> list[int | None]:
        names = {context.name for context in self.story.contexts if task not in context.suspends}
        names &= names if contexts is None else set(contexts)
        return [one for run in runs for name in sorted(names) for one in run.responses[task][name]]


def _quantile(times: Sequence[float], part: float) -> float:
    found = sorted(times)
    return found[math.ceil(part * len(found)) - 1] / TENTHS if found else math.nan
