"""What the robot of this benchmark does: its tasks, and the contexts that say which of them is critical. Pure.

The tasks are those of a robot that drives, listens and reads signs; together they want 1.5 times two processors. A load
scales what an input costs, not how often inputs come. When a task's first input comes is drawn again for each block, as
sensors are not in step.

Control loops and SLAM have to be done before the next input comes (the IMU's filter buffers one). Speech, signs and the
map may take two periods, which is half or less of what the modules of this repository allow themselves; with the newest
input only that means to keep up.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field, replace

PROCESSORS = 2
"""What the tasks run on, however many the machine has: each has one thread, and more would make another benchmark."""


@dataclass(frozen=True, slots=True)
class Task:
    """A robot's function: `cost` CPU seconds for each of `rate` inputs a second, due `deadline` seconds later.

    `priority` is what its pod would request in proportion to if nobody knew of contexts. A protected task may be
    weighted down, but never suspended.
    """

    name: str
    rate: float
    cost: float
    deadline: float
    priority: float
    protected: bool = False

    @property
    def wants(self) -> float:
        """Cores."""
        return self.rate * self.cost


@dataclass(frozen=True, slots=True)
class Context:
    """Which task matters while it holds, and which it suspends."""

    name: str
    critical: str
    suspends: frozenset[str] = field(default_factory=frozenset)


@dataclass(frozen=True, slots=True)
class Story:
    """Contexts that take turns."""

    name: str
    contexts: tuple[Context, ...]

    def context(self, name: str) -> Context:
        """Its context of that name."""
        return next(context for context in self.contexts if context.name == name)


@dataclass(frozen=True, slots=True)
class Script:
    """A story played once: each context holds for `seconds`. The seed says when each task's first input comes."""

    story: Story
    seconds: float
    seed: int = 0

    @property
    def end(self) -> float:
        """When no input arrives any more."""
        return self.seconds * len(self.story.contexts)

    def phase(self, task: Task) -> float:
        """When the task's first input comes: within its first period."""
        return random.Random(f"{self.seed} {task.name}").random() / task.rate  # noqa: S311 - no secret

    def count(self, task: Task) -> int:
        """How many of its inputs come."""
        return math.ceil((self.end - self.phase(task)) * task.rate - 1e-9)

    def at(self, time: float) -> Context:
        """The context that holds then; the last one stays."""
        return self.story.contexts[min(int(time / self.seconds), len(self.story.contexts) - 1)]

    def windows(self, task: str) -> list[tuple[float, float]]:
        """When no context suspends the task, in order; the last window stays open if the last context is one."""
        found: list[tuple[float, float]] = []
        for number, context in enumerate(self.story.contexts):
            begin, end = number * self.seconds, (number + 1) * self.seconds
            if task in context.suspends:
                continue
            if found and found[-1][1] == begin:
                begin = found.pop()[0]
            found.append((begin, end))
        if found and found[-1][1] == self.end:
            found[-1] = (found[-1][0], float("inf"))
        return found


BASE = (
    Task("nav", rate=20, cost=0.005, deadline=0.05, priority=10, protected=True),
    Task("imu", rate=200, cost=0.0004, deadline=0.01, priority=10, protected=True),
    Task("slam", rate=10, cost=0.07, deadline=0.1, priority=8),
    Task("speech", rate=10, cost=0.06, deadline=0.2, priority=6),
    Task("signs", rate=4, cost=0.2, deadline=0.5, priority=4),
    Task("map", rate=4, cost=0.18, deadline=0.5, priority=2),
)
IMPORTANCE = Story("importance", (Context("drive", "slam"), Context("talk", "speech"), Context("read", "signs")))
"""Importance moves among tasks, and none of them can be suspended."""
SUSPENDING = Story(
    "suspending",
    (
        Context("drive", "slam", frozenset({"signs"})),
        Context("talk", "speech", frozenset({"map"})),
        Context("read", "signs", frozenset({"slam"})),
    ),
)
"""The same, and each context does without one task."""
STORIES = {story.name: story for story in (IMPORTANCE, SUSPENDING)}


def tasks(load: float) -> tuple[Task, ...]:
    """The tasks, together wanting `load` times what the processors have."""
    scale = load * PROCESSORS / sum(task.wants for task in BASE)
    return tuple(replace(task, cost=task.cost * scale) for task in BASE)


def critical_fit(load: float) -> bool:
    """Whether the tasks that are critical in some context would fit on the processors together."""
    critical = {context.critical for context in IMPORTANCE.contexts}
    return sum(task.wants for task in tasks(load) if task.name in critical) <= PROCESSORS
