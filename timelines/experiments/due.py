"""What is due in a story: every input of every task, and what its context wants of it. The same for every run. Pure.

It follows from the timeline and from the contexts that the policy's simulation finds on it, never from a run: nobody
can improve a rate by doing less.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from contextpolicy.planning.allocation.plan import Plan

NO_CONTEXT = "none"
TENTHS = 10_000
"""Of a millisecond, in a second."""
ONSET = 1.0
"""Seconds at the begin of a context that are reported apart as well: what a change costs."""


class Window(NamedTuple):
    """A stretch of the story (seconds) with the contexts that hold in it and the tasks that they suspend."""

    begin: float
    end: float
    contexts: tuple[str, ...]
    suspended: frozenset[str]

    @property
    def name(self) -> str:
        """Its contexts in words."""
        return "+".join(self.contexts) or NO_CONTEXT


class Due(NamedTuple):
    """One input of a task: the n-th of its key, at `at` seconds of the story.

    `wanted` is whether its context lets the task work; `onset` whether that context has only begun.
    """

    input: str
    number: int
    at: float
    context: str
    wanted: bool
    onset: bool


@dataclass(frozen=True, slots=True)
class Schedule:
    """A story as what is due in it. `keys` has when each key's inputs come, in seconds, ascending.

    `inputs` has the key of each task's inputs, `deadlines` seconds from an input to its result, `stops` when each
    spoken "stop" begins and ends.
    """

    duration: float
    keys: Mapping[str, Sequence[float]]
    inputs: Mapping[str, Mapping[str, str]]
    deadlines: Mapping[str, float]
    windows: Sequence[Window]
    stops: Sequence[tuple[float, float]] = ()
    _due: dict[str, list[Due]] = field(default_factory=dict, init=False, repr=False, compare=False)

    def of(self, task: str) -> list[Due]:
        """All that is due of a task, input by input."""
        if task not in self._due:
            self._due[task] = [one for name in self.inputs[task] for one in self._of_input(task, name)]
        return self._due[task]

    def wants(self, task: str, at: float) -> bool:
        """Whether the context that holds at a moment of the story lets the task work."""
        return task not in self._window(at).suspended

    def _window(self, at: float) -> Window:
        return self.windows[max(bisect_right([window.begin for window in self.windows], at) - 1, 0)]

    def _of_input(self, task: str, name: str) -> Iterator[Due]:
        for number, at in enumerate(self.keys.get(self.inputs[task][name], ())):
            window = self._window(at)
            yield Due(name, number, at, window.name, task not in window.suspended, at < window.begin + ONSET)

    def as_json(self) -> dict[str, Any]:
        """Plain data, times in tenths of a millisecond."""
        return {
            "duration": self.duration,
            "keys": {key: [round(at * TENTHS) for at in times] for key, times in self.keys.items()},
            "inputs": {task: dict(own) for task, own in self.inputs.items()},
            "deadlines": dict(self.deadlines),
            "windows": [[one.begin, one.end, list(one.contexts), sorted(one.suspended)] for one in self.windows],
            "stops": [list(one) for one in self.stops],
        }

    @classmethod
    def of_json(cls, value: Mapping[str, Any]) -> Schedule:
        """What `as_json` wrote."""
        keys = {key: [at / TENTHS for at in times] for key, times in value["keys"].items()}
        windows = [Window(begin, end, tuple(names), frozenset(away)) for begin, end, names, away in value["windows"]]
        stops = [(float(begin), float(end)) for begin, end in value["stops"]]
        return cls(value["duration"], keys, value["inputs"], value["deadlines"], windows, stops)


def windows(plans: Iterable[Plan], duration: float) -> list[Window]:
    """The contexts of a simulation's plans, the first one's from the begin on; neighbours that agree are one."""
    changes = [(plan.time, plan.contexts, _suspended(plan)) for plan in plans if plan.time < duration]
    found: list[Window] = []
    for number, (time, contexts, suspended) in enumerate(changes):
        end = changes[number + 1][0] if number + 1 < len(changes) else duration
        begin = time if found else 0.0
        if found and (found[-1].contexts, found[-1].suspended) == (contexts, suspended):
            found[-1] = found[-1]._replace(end=end)
        elif end > begin:
            found.append(Window(begin, end, contexts, suspended))
    return found or [Window(0.0, duration, (), frozenset())]


def _suspended(plan: Plan) -> frozenset[str]:
    return frozenset(name for name, task in plan.tasks.items() if task.suspended)
