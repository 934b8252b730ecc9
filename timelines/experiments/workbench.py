"""Single runs: each is done once, on the node, and read again afterwards."""

from __future__ import annotations

import datetime as dt
import json
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from contextpolicy.streams.timeline import load
from timelines.demo import deploy
from timelines.experiments import collect, installation
from timelines.experiments.accuracy import Judge
from timelines.experiments.calm import DisturbedError
from timelines.experiments.capacity import WHOLE, Capacity
from timelines.experiments.code_version import code_version
from timelines.experiments.earlier import Earlier, Kind
from timelines.experiments.evidence import ENDING, Evidence
from timelines.experiments.metrics import Run
from timelines.experiments.raw_data import PROFILES, RUN, read_run
from timelines.experiments.record import Record, RecordError, packed, unpacked, write_whole
from timelines.experiments.run import Conditions, execute
from timelines.experiments.schedules import fingerprint, schedule
from timelines.experiments.stories import Use
from timelines.experiments.tasks import TASKS, module
from timelines.experiments.validity import RejectedError, reasons

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from timelines.experiments.blocks import Trial
    from timelines.experiments.due import Schedule
    from timelines.experiments.stories import Story

TRIES = 3
"""How often a run is begun before the node counts as broken: a timeout of helm must not end a night of runs."""
DISTURBED = 10
"""The same for a run that the machine disturbed, which is to be expected where a host is shared."""
REJECTED = ".rejected-"
"""In the names of files of attempts that do not count."""
LONGEST = 300
"""Characters of a failure that are kept."""


@dataclass(frozen=True, slots=True)
class Folders:
    """Where things are: recordings of single runs (`raw`), what is committed (`data`), and what is played."""

    raw: Path
    data: Path
    datasets: Path
    timelines: Path
    """The stories' timelines, as `python -m timelines.scenarios` makes them."""

    def timeline(self, story: Story) -> Path:
        """A story's timeline; the paper's are committed."""
        folder = deploy.REPOSITORY / "timelines" if story.use is Use.PAPER else self.timelines
        return folder / f"{story.name}.json"


@dataclass(frozen=True, slots=True)
class Setting:
    """What all runs of a load have in common: what the tasks share, and their deadlines (seconds)."""

    capacity: Capacity
    deadlines: Mapping[str, float]


class Workbench:
    """Does single runs, none of them twice: what is finished is read again.

    `whole` turns a second count as a whole processor here.
    """

    def __init__(self, folders: Folders) -> None:
        self.folders = folders
        self.whole = WHOLE
        self._earlier = Earlier(Evidence.read(folders.data).every())
        self._compared: set[Path] = set()
        self.took: dict[str, tuple[float, float]] = {}
        self._installed: tuple[bool, bool, float | None] | None = None  # nothing is
        self._schedules: dict[str, Schedule] = {}
        self._code = code_version(deploy.REPOSITORY)

    def has(self, place: str, trial: Trial) -> bool:
        """Whether a run is finished."""
        return self._file(place, trial).exists()

    def record(self, place: str, trial: Trial, setting: Setting, weights: Mapping[str, int]) -> Record:
        """The record of a run, which is done if it was not yet; `place` is a folder of such runs.

        DeployError if it was done under another load: what was calibrated has changed since.
        """
        path = self._file(place, trial)
        if not path.exists():
            self._do(place, trial, setting, weights)
        found = Record.of_json(unpacked(path.read_bytes()))
        capacity = Capacity(*found.about["capacity"])
        if capacity != setting.capacity:
            raise deploy.DeployError(f"{path}: on {capacity}, not {setting.capacity}: delete it, and its folder")
        self._compare_with(path, Run(self.schedule(trial.story, setting.deadlines), found))
        return found

    def rejected(self, place: str, trial: Trial) -> list[Record]:
        """The attempts at a run that were played and do not count."""
        return [Record.of_json(unpacked(path.read_bytes())) for path in self._set_aside_files(place, trial)]

    def profiles(self, place: str, trial: Trial) -> dict[str, Any]:
        """What each task's inputs cost in a run that is finished."""
        found: dict[str, Any] = json.loads((self._folder(place, trial) / PROFILES).read_text(encoding="utf-8"))
        return found

    def schedule(self, story: Story, deadlines: Mapping[str, float]) -> Schedule:
        """What is due in a story."""
        timeline = self.folders.timeline(story)
        key = fingerprint(story, timeline, deadlines)
        if key not in self._schedules:
            cores = installation.cores()
            self._schedules[key] = schedule(story, timeline, self.folders.datasets, deadlines, cores)
        return self._schedules[key]

    def _compare_with(self, path: Path, run: Run) -> None:
        """Judge later runs by this one, also where an earlier call has done it and its block is not whole yet."""
        if path not in self._compared:
            self._compared.add(path)
            self._earlier.add(run)

    def _do(self, place: str, trial: Trial, setting: Setting, weights: Mapping[str, int]) -> None:
        began = dt.datetime.now(tz=dt.UTC)
        due = self.schedule(trial.story, setting.deadlines)
        conditions = partial(self._conditions, trial, setting.capacity, weights)
        found, failures = self._tried(place, trial, conditions, due)
        if code_version(deploy.REPOSITORY) != self._code:
            (self._folder(place, trial) / RUN).unlink(missing_ok=True)  # it is played again, and not only read
            raise RecordError(f"{trial}: the code is not {self._code} any more: change nothing, and run it again")
        kept = replace(found, about={**found.about, "failures": failures})
        write_whole(self._file(place, trial), packed(kept.as_json()))
        self.took[f"{place}/{trial.name}"] = (trial.seconds, (dt.datetime.now(tz=dt.UTC) - began).total_seconds())

    def _conditions(self, trial: Trial, capacity: Capacity, weights: Mapping[str, int]) -> Conditions:
        """What the next attempt happens under: how fast its processors will be, the ones before show."""
        expected = self._earlier.expected(Kind.here(capacity, trial.configuration.name))
        timeline = self._timeline(trial)
        return Conditions(timeline, self.folders.datasets, capacity, self.whole, expected, weights, self._code)

    def _tried(
        self, place: str, trial: Trial, conditions: Callable[[], Conditions], due: Schedule
    ) -> tuple[Record, list[str]]:
        """Do a run, TRIES times at most where anything fails, and return what failed: it is kept with the record.

        A run that the machine disturbed says nothing of the node, and is repeated more often.

        One that was played, and not understood before we were stopped, is only read.
        """
        failures: list[str] = []
        folder, broken = self._folder(place, trial), 0
        while True:
            try:
                if not (folder / RUN).exists():
                    self._install(trial)
                    execute(trial, conditions(), folder)
                return self._accepted(trial, folder, due), failures
            except Exception as error:  # whatever it is: one run must not end a night of them
                self._installed = None  # everything is installed again, whatever was there
                (folder / RUN).unlink(missing_ok=True)  # what can't be understood is played again
                failures.append(f"{type(error).__name__}: {error}"[:LONGEST])
                if isinstance(error, RejectedError):
                    self._set_aside(place, trial, error)
                    self._earlier.note_speed(error.record)
                broken += not isinstance(error, DisturbedError)
                if broken == TRIES or len(failures) == DISTURBED:
                    raise deploy.DeployError(f"failed {len(failures)} times, at last: {error}") from error

    def _accepted(self, trial: Trial, folder: Path, due: Schedule) -> Record:
        """The record of a run that was played; RejectedError if it does not count."""
        found = self._understood(trial, folder, due)
        why = [*reasons(found), *self._earlier.reasons(Run(due, found))]
        if why:
            raise RejectedError(found, why)
        return found

    def _set_aside(self, place: str, trial: Trial, error: RejectedError) -> None:
        """Keep what does not count: whether rejection favours a configuration, its reader has to be able to see."""
        file, kept = self._file(place, trial), len(self._set_aside_files(place, trial))
        about = {**error.record.about, "failures": [str(error)]}
        path = file.with_name(f"{trial.name}{REJECTED}{kept + 1}{ENDING}")
        write_whole(path, packed(replace(error.record, about=about).as_json()))

    def _set_aside_files(self, place: str, trial: Trial) -> list[Path]:
        return sorted(self._file(place, trial).parent.glob(f"{trial.name}{REJECTED}*{ENDING}"))

    def _understood(self, trial: Trial, folder: Path, due: Schedule) -> Record:
        run, judge = read_run(folder), Judge(load(self._timeline(trial)), due, self.folders.datasets)
        return collect.record(trial, run, due, judge.accuracy(run))

    def _install(self, trial: Trial) -> None:
        """Install the operator again only where another configuration needs it otherwise."""
        wanted = trial.configuration.agent, trial.configuration.realtime, trial.configuration.settle
        if self._installed != wanted:
            installation.stop_robot()
            installation.install(trial.configuration)
            self._installed = wanted

    def _timeline(self, trial: Trial) -> Path:
        return self.folders.timeline(trial.story)

    def _folder(self, place: str, trial: Trial) -> Path:
        return self.folders.raw / "runs" / place / trial.name

    def _file(self, place: str, trial: Trial) -> Path:
        return self._folder(place, trial).with_suffix(ENDING)


def own_deadlines() -> dict[str, float]:
    """What each module says of itself, in seconds."""
    needs = {task: module(task).needs.deadline for task in TASKS}
    return {task: deadline for task, deadline in needs.items() if deadline is not None}
