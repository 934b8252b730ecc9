"""What is run, and in which order. Pure."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, NamedTuple

from timelines.experiments.configurations import ALL, CFS, LINUX_DEFAULT, MAIN, REST, RT, WEIGHT, Configuration

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

REAL_PACE, FAST = 1.0, 6.0
"""How fast the inputs come. The paper's Raspberry Pi had more to do than it could. So have two cores of a server at
six times the pace, as a machine of a sixth of their speed would at real pace. Where a machine keeps up, nothing can
end earlier."""

EXPERIMENTS: Mapping[str, Mapping[float, Sequence[Configuration]]] = {
    "exp1": {FAST: MAIN},
    "exp2": {FAST: (LINUX_DEFAULT, CFS, *REST, RT)},
    "exp3": {REAL_PACE: ALL, FAST: (*MAIN, WEIGHT)},
}
"""Of each timeline: which configurations at which pace. All of it, three times, takes about an hour."""


class Trial(NamedTuple):
    """One run to do: a timeline at a pace, under a configuration, for the n-th time."""

    experiment: str
    pace: float
    configuration: Configuration
    repeat: int

    def __str__(self) -> str:
        return f"{self.series} {self.configuration.title}, repeat {self.repeat}"

    @property
    def series(self) -> str:
        """The runs that are compared with each other: exp3-x6 is exp3 at six times the pace."""
        return f"{self.experiment}-x{self.pace:g}"

    def folder(self, out: Path) -> Path:
        """Where its raw data is kept."""
        return out / self.series / self.configuration.name / str(self.repeat)


def trials(
    experiments: Sequence[str],
    repeats: int,
    *,
    paces: Sequence[float] = (),
    only: Sequence[str] = (),
    can: Callable[[Configuration], bool] = lambda _: True,
) -> Iterator[Trial]:
    """All runs; repeats are interleaved, so that a change of the machine meets all configurations alike.

    `paces` and `only` (names of configurations) choose among them, `can` says what this node is able to do. The ideal
    has one repeat: nothing contends with it.
    """
    able = [one for one in ALL if (not only or one.name in only) and can(one)]
    for experiment, repeat, configuration in product(experiments, range(repeats), able):
        for pace, own in EXPERIMENTS[experiment].items():
            if configuration in own and (not paces or pace in paces) and not (configuration.alone and repeat):
                yield Trial(experiment, pace, configuration, repeat)


def longest(done: Sequence[float], duration: float, pace: float) -> float:
    """Seconds that the next run may take, by those that are done; for a first one, twice its inputs and the start."""
    return max(done, default=2 * duration / pace + START)


START = 60.0
"""Seconds to start and stop the robot's pods, on a busy machine."""
