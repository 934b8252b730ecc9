"""Runs of one timeline at one pace, by configuration and repeat: what is compared with each other."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from timelines.experiments.accuracy import accuracy
from timelines.experiments.configurations import ALL, BASELINE, IDEAL
from timelines.experiments.raw_data import read_run
from timelines.experiments.run import RUN
from timelines.experiments.trials import EXPERIMENTS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from timelines.experiments.accuracy import Accuracy
    from timelines.experiments.raw_data import RunData


@dataclass
class Series:
    """`runs` are by configuration and repeat, in the order of the configurations; the ideal is not among them."""

    experiment: str
    pace: float
    runs: dict[str, dict[int, RunData]]
    accuracies: Mapping[RunData, Mapping[str, Accuracy]] = field(default_factory=dict)
    folders: Mapping[RunData, Path] = field(default_factory=dict)
    ideal: RunData | None = None
    """The same inputs, each task alone."""

    @property
    def name(self) -> str:
        """The name of its folder, and of its figures."""
        return f"{self.experiment}-x{self.pace:g}"

    @property
    def title(self) -> str:
        """For people."""
        return f"{self.experiment} at {'real pace' if self.pace == 1 else f'{self.pace:g} times the pace'}"

    @property
    def first(self) -> RunData:
        """Any of the runs."""
        return next(self.each())

    def each(self) -> Iterator[RunData]:
        """All runs."""
        for repeats in self.runs.values():
            yield from repeats.values()

    def of(self, configuration: str) -> list[RunData]:
        """A configuration's runs."""
        return list(self.runs.get(configuration, {}).values())

    def paired(
        self, configuration: str, compare: Callable[[RunData, RunData], float | None], baseline: str = BASELINE
    ) -> list[float]:
        """Compare each run with the baseline's of the same repeat, which ran shortly before; None is left out."""
        other, own = self.runs.get(baseline, {}), self.runs.get(configuration, {})
        found = [compare(other[repeat], run) for repeat, run in own.items() if repeat in other]
        return [value for value in found if value is not None]


def read_series(out: Path, datasets: Path) -> list[Series]:
    """All series that have a finished run, in the order of experiments and paces."""
    found = []
    for experiment, paces in EXPERIMENTS.items():
        every = [_read(out, experiment, pace, datasets) for pace in paces]
        alone = [run for series in every for run in series.of(IDEAL)]
        for series in every:
            series.runs.pop(IDEAL, None)
            series.ideal = alone[0] if alone else None
        found += [series for series in every if series.runs]
    return found


def _read(out: Path, experiment: str, pace: float, datasets: Path) -> Series:
    series = Series(experiment, pace, {})
    folders: dict[RunData, Path] = {}
    for one in ALL:
        paths = sorted((path.parent for path in (out / series.name).glob(f"{one.name}/*/{RUN}")), key=_number)
        repeats = {_number(path): read_run(path) for path in paths}
        folders |= {repeats[_number(path)]: path for path in paths}
        if repeats:
            series.runs[one.name] = repeats
    series.folders = folders
    series.accuracies = {run: accuracy(run, folder, datasets) for run, folder in folders.items()}
    return series


def _number(folder: Path) -> int:
    return int(folder.name)
