"""Whether a promoted shadow makes the tasks miss more of their inputs than before. Pure: time is an argument.

Each task has a one-sided cumulative sum (CUSUM, Page 1954): what it misses beyond the misses before and the tolerance,
added up over time and never below 0. A sudden starvation is found within seconds, a small rise within minutes, and a
task that recovers in between starts from 0 again. The misses before are kept by the contexts that held: a robot that
drives misses more than one that stands, under any policy.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from contextpolicy.policy.spec import Shadow

LONGEST = 10.0
"""Seconds that one report may stand for: a task that was silent for longer was gone, not late."""
ENOUGH = 10.0
"""Seconds of reports that make a comparison: fewer are chance."""


@dataclass(slots=True)
class _Misses:
    """A mean over time."""

    missed: float = 0.0
    seconds: float = 0.0

    def add(self, part: float, seconds: float) -> None:
        self.missed += part * seconds
        self.seconds += seconds

    @property
    def mean(self) -> float:
        return self.missed / self.seconds if self.seconds else 0.0


class Probation:
    """The misses of a policy's tasks, before and since its shadow was promoted.

    `recalled` are the misses before, by task, that an earlier operator has left in the status.
    """

    def __init__(self, recalled: Mapping[str, float] | None = None) -> None:
        self._recalled = dict(recalled or {})
        self._before: dict[str, dict[tuple[str, ...], _Misses]] = {}
        self._since: dict[str, _Misses] = {}
        self._excess: dict[str, float] = defaultdict(float)
        self._heard: dict[str, float] = {}

    @property
    def tasks(self) -> list[str]:
        """The tasks whose misses are known."""
        return sorted(self._recalled.keys() | self._before.keys() | self._since.keys())

    def keep(self, tasks: Collection[str]) -> None:
        """Forget all tasks but these: the shadow was edited."""
        for known in (self._recalled, self._before, self._since, self._excess, self._heard):
            for task in known.keys() - set(tasks):
                del known[task]

    def restart(self) -> None:
        """The shadow is promoted, again perhaps: judge what comes from now on."""
        self._since.clear()
        self._excess.clear()

    def rest(self, task: str) -> None:
        """The task is suspended: it misses nothing until it reports again."""
        self._heard.pop(task, None)

    def learn(self, task: str, misses: float, contexts: tuple[str, ...], now: float) -> bool:
        """A report while the shadow is not promoted: the part of its inputs that the task missed, in these contexts.

        True when this makes its misses known.
        """
        unknown = self.before(task) is None
        by_contexts = self._before.setdefault(task, {})
        by_contexts.setdefault(contexts, _Misses()).add(misses, self._lasted(task, now))
        return unknown and self.before(task) is not None

    def judge(self, shadow: Shadow, task: str, misses: float, contexts: tuple[str, ...], now: float) -> bool:
        """A report while the shadow is promoted; True when its promotion is to be reverted."""
        seconds = self._lasted(task, now)
        self._since.setdefault(task, _Misses()).add(misses, seconds)
        beyond = misses - self._expected(task, contexts) - shadow.tolerance
        self._excess[task] = max(0.0, self._excess[task] + beyond * seconds)
        return self._excess[task] >= shadow.patience

    def before(self, task: str) -> float | None:
        """The misses before the promotion, in the contexts where there were most; None if too few were reported."""
        known = [own.mean for own in self._before.get(task, {}).values() if own.seconds >= ENOUGH]
        return max(known) if known else self._recalled.get(task)

    def since(self, task: str) -> float | None:
        """The misses since the promotion; None if none were reported."""
        return self._since[task].mean if task in self._since else None

    def _expected(self, task: str, contexts: tuple[str, ...]) -> float:
        """Where these contexts were not seen before, the worst of those that were; without any, nothing is missed."""
        own = self._before.get(task, {}).get(contexts)
        return own.mean if own is not None and own.seconds >= ENOUGH else self.before(task) or 0.0

    def _lasted(self, task: str, now: float) -> float:
        seconds = min(now - self._heard.get(task, now), LONGEST)
        self._heard[task] = now
        return seconds
