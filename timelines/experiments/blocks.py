"""What is run, and in which order: complete blocks, randomised by a seed. Pure."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING, NamedTuple

from timelines.experiments.configurations import (
    ALONE,
    DIVISIONS,
    FACTORS,
    FIRST_LAW,
    PAPERS,
    REALTIME,
    VARIANTS,
    Configuration,
)
from timelines.experiments.stories import HELD_OUT, PAPER, STORIES, Story

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

SEED = 20_261_126
LIGHT, HEAVY, PAPERS_LOAD = "light", "heavy", "paper"
"""The loads; the paper's stories ask for less at a time, and have a heavy one of their own."""
UNSLOWED = "unslowed"
"""Processors as they are: what slows them has realtime priority, and would compete with tasks that have it, too."""
SWEEP: Sequence[str] = ("1.1", "1.25", "1.6")
"""Loads around the heavy one, to see from which one on contexts are needed."""
START = 17.0
"""Seconds to start and stop the robot's pods and to wait until all is quiet, before any run has shown it."""
ALONE_BLOCKS = 2
"""How often each task is run alone where goals compare with it: nothing contends with it, so its runs hardly differ."""
TASKS = 7
"""Tasks that are played one after the other where each is alone."""


class Part(NamedTuple):
    """Configurations that are compared with each other on the same stories, in so many blocks."""

    load: str
    stories: Sequence[Story]
    configurations: Sequence[Configuration]
    blocks: int


PLAN: Sequence[Part] = (
    Part(HEAVY, HELD_OUT, (ALONE,), ALONE_BLOCKS),
    Part(HEAVY, HELD_OUT, FACTORS, 10),
    Part(LIGHT, HELD_OUT, FIRST_LAW, 10),
    *(Part(load, HELD_OUT, DIVISIONS, 3) for load in SWEEP),
    Part(PAPERS_LOAD, PAPER, PAPERS, 3),
    Part(HEAVY, HELD_OUT, VARIANTS, 3),
    Part(UNSLOWED, (STORIES["exp2"],), (REALTIME,), 1),
)
"""In the order of what a claim needs first; of Realtime it is only shown how it decides."""


def part_of(load: str, configuration: str) -> int:
    """The number of the part of which a run is."""
    return next(
        number
        for number, part in enumerate(PLAN)
        if part.load == load and configuration in {one.name for one in part.configurations}
    )


class Trial(NamedTuple):
    """One run: a story under a load and a configuration, in a block of its part."""

    load: str
    story: Story
    configuration: Configuration
    part: int
    block: int

    def __str__(self) -> str:
        return f"{self.story.name}, {self.load} load, {self.configuration.title}, block {self.block + 1}"

    @property
    def group(self) -> str:
        """The block that it belongs to, as a file's name."""
        return f"{self.part + 1}-{self.load}-{self.block + 1:02}"

    @property
    def name(self) -> str:
        """Its own, within the group."""
        return f"{self.story.name}-{self.configuration.name}"

    @property
    def cell(self) -> tuple[str, str, str, int]:
        """Where it is among all runs: load, story, configuration and block."""
        return self.load, self.story.name, self.configuration.name, self.block

    @property
    def seconds(self) -> float:
        """How long inputs come."""
        return self.story.seconds * (TASKS if self.configuration.alone else 1)


def trials(
    *,
    parts: Sequence[Part] = PLAN,
    stories: Iterable[str] = (),
    only: Iterable[str] = (),
    loads: Iterable[str] = (),
    most: int | None = None,
) -> Iterator[Trial]:
    """All runs, block after block: each has every configuration once per story, in an order of its own.

    `stories`, `only` (configurations) and `loads` choose among them, `most` bounds the blocks of each part.
    """
    chosen, wanted, under = frozenset(stories), frozenset(only), frozenset(loads)
    for number, part in enumerate(parts):
        cells = [
            (story, one)
            for story in part.stories
            for one in part.configurations
            if (not chosen or story.name in chosen)
            and (not wanted or one.name in wanted)
            and (not under or part.load in under)
        ]
        for block in range(part.blocks if most is None else min(most, part.blocks)):
            order = list(cells)
            random.Random(f"{SEED} {number} {block}").shuffle(order)  # noqa: S311 - no secret
            yield from (Trial(part.load, story, one, number, block) for story, one in order)


def seconds_left(took: Mapping[str, tuple[float, float]], left: Iterable[Trial]) -> float:
    """How long the rest may take; `took` has (seconds of inputs, seconds in all) of the runs that are done."""
    beside = [whole - inputs for inputs, whole in took.values()]
    start = sum(beside) / len(beside) if beside else START
    return sum(trial.seconds + start for trial in left)
