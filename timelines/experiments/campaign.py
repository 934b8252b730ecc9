"""All runs, or what is left of them: block after block, each kept as it ends."""

from __future__ import annotations

import subprocess
from typing import TYPE_CHECKING, Protocol

from contextpolicy.errors import ContextPolicyError
from timelines.demo import deploy
from timelines.experiments.blocks import seconds_left
from timelines.experiments.evidence import BLOCKS, ENDING, REJECTED, note_absent, write_schedule
from timelines.experiments.record import block, records, write_whole

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from timelines.experiments.blocks import Trial
    from timelines.experiments.record import Record
    from timelines.experiments.workbench import Setting, Workbench


IN_A_ROW = 2
"""Configurations that fail one after the other: then the node is broken, and nothing else is begun."""
LONGEST = 300
"""Characters of a reason in the report."""


class Progress(Protocol):
    """Where it is reported what is done, and how long the rest takes."""

    def say(self, line: str) -> None:
        """Report a line."""


class Campaign:
    """Blocks of runs, one after the other."""

    def __init__(
        self,
        bench: Workbench,
        settings: Mapping[str, Setting],
        tuned: Mapping[str, Mapping[bool, Mapping[str, int]]],
        progress: Progress,
    ) -> None:
        """`settings` are by load, and so are `tuned`, the searched weights without and with gating."""
        self._bench, self._settings, self._tuned, self._progress = bench, settings, tuned, progress
        self._in_a_row = 0
        self._given_up: set[tuple[str, str]] = set()
        self._cells: dict[str, frozenset[tuple[str, str]]] = {}

    @property
    def failed(self) -> bool:
        """Whether a configuration was given up."""
        return bool(self._given_up)

    def missing(self, trials: Sequence[Trial]) -> list[Trial]:
        """Those of these runs that are not done yet."""
        return [trial for trial in trials if not self._has(trial)]

    def run(self, trials: Sequence[Trial], *, until: Callable[[float], bool], commit: bool) -> int:
        """Do what is missing while `until` says that so many seconds are left; returns how many runs are left.

        A run that a block's file has is not repeated where its recording is gone, as after a new checkout. A
        configuration that fails is left out, so that the others are measured.
        """
        self._keep_what_is_due(trials)
        missing = self.missing(trials)
        if trials and not missing:
            folders = self._bench.folders
            self._progress.say(f"all runs are done: delete {folders.raw} and {folders.data} to start over")
        for number, trial in enumerate(missing):
            if self._is_given_up(trial):
                continue
            if not until(seconds_left(self._bench.took, self._next(missing, number))):
                break
            minutes = seconds_left(self._bench.took, missing[number:]) / 60
            self._progress.say(f"[{number + 1}/{len(missing)}, {minutes:.0f} min left] {trial}")
            self._attempt(trial, missing)
            self._keep_rejected(trial)
            self._keep(trial.group, trials, commit=commit)
        self._keep_what_was_lost(trials, commit=commit)
        return sum(not self._has(trial) for trial in missing)

    def _leave_out(self, trials: Sequence[Trial], reason: str) -> None:
        """Report that these runs, all of one configuration under one load, can't be done."""
        first = trials[0]
        self._progress.say(f"not run: {first.configuration.title}, {first.load} load: {reason}")
        note_absent(self._bench.folders.data, [one.cell for one in trials], " ".join(reason.split())[:LONGEST])

    def _next(self, missing: Sequence[Trial], number: int) -> list[Trial]:
        """What has to end in time for this run to begin: itself, and all of its block where that is not begun yet.

        What differs within a block should be the configuration, and not the day. The first run of a call only has to
        end itself: its block may have begun in an earlier call.
        """
        rest = [trial for trial in missing[number:] if trial.group == missing[number].group]
        begun = not number or missing[number - 1].group == missing[number].group
        return rest[:1] if begun else rest

    def _keep_what_is_due(self, trials: Sequence[Trial]) -> None:
        """Write what is due in each story; RecordError before anything is run if it has changed since."""
        for load, story in {trial.story.name: (trial.load, trial.story) for trial in trials}.values():
            due = self._bench.schedule(story, self._settings[load].deadlines)
            write_schedule(self._bench.folders.data, story.name, due)

    def _attempt(self, trial: Trial, missing: Sequence[Trial]) -> None:
        """Do a run; DeployError or ContextPolicyError where another configuration failed just before."""
        try:
            self._record(trial)
        except (deploy.DeployError, ContextPolicyError) as error:
            own = trial.load, trial.configuration.name
            self._leave_out(
                [one for one in missing if (one.load, one.configuration.name) == own and not self._has(one)], str(error)
            )
            self._given_up.add(own)
            self._in_a_row += 1
            if self._in_a_row == IN_A_ROW:
                raise
        else:
            self._in_a_row = 0

    def _is_given_up(self, trial: Trial) -> bool:
        return (trial.load, trial.configuration.name) in self._given_up

    def _keep_what_was_lost(self, trials: Sequence[Trial], *, commit: bool) -> None:
        """Write blocks that are done and have no file: it was lost, or we were stopped before it was written."""
        for group in dict.fromkeys(trial.group for trial in trials):
            if not self._path(group).exists():
                self._keep(group, trials, commit=commit)

    def _has(self, trial: Trial) -> bool:
        return self._bench.has(trial.group, trial) or _cell(trial) in self._cells_of(trial.group)

    def _cells_of(self, group: str) -> frozenset[tuple[str, str]]:
        """What a block's file has, which is large: it is read once."""
        if group not in self._cells:
            self._cells[group] = frozenset(self._kept(group))
        return self._cells[group]

    def _kept(self, group: str) -> Mapping[tuple[str, str], Record]:
        """What a block's file has, by story and configuration."""
        path = self._path(group)
        found = records(path.read_bytes()) if path.exists() else []
        return {(one.story, one.configuration): one for one in found}

    def _record(self, trial: Trial) -> Record:
        setting, weights = self._settings[trial.load], self._tuned[trial.load][trial.configuration.gated]
        return self._bench.record(trial.group, trial, setting, weights)

    def _keep(self, group: str, trials: Sequence[Trial], *, commit: bool) -> None:
        """Write a block's file once all of its runs are done."""
        own = [trial for trial in trials if trial.group == group and not self._is_given_up(trial)]
        if not own or not all(self._has(trial) for trial in own):
            return
        done = [trial for trial in own if self._bench.has(group, trial)]
        found = {**self._kept(group), **{_cell(trial): self._record(trial) for trial in done}}
        path = self._path(group)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, block(found.values()))
        self._cells[group] = frozenset(found)
        failed = commit_folder(self._bench.folders.data, f"Keep block {group} of the experiments") if commit else ""
        if failed:  # the block is kept, and the next commit has it
            self._progress.say(failed)

    def _keep_rejected(self, trial: Trial) -> None:
        """Write the attempts at a run that do not count, also where it was given up, beside others of its block."""
        path = self._bench.folders.data / REJECTED / f"{trial.group}{ENDING}"
        rejected = self._bench.rejected(trial.group, trial)
        if rejected:
            before = records(path.read_bytes()) if path.exists() else []
            found = {one.about["date"]: one for one in (*before, *rejected)}
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, block(found.values()))

    def _path(self, group: str) -> Path:
        return self._bench.folders.data / BLOCKS / f"{group}{ENDING}"


def _cell(trial: Trial) -> tuple[str, str]:
    return trial.story.name, trial.configuration.name


def commit_folder(data: Path, message: str) -> str:
    """Commit what has changed in a folder, and nothing else; returns what git refuses, else nothing."""
    added = _git("add", "--", str(data))
    if added.returncode or not _git("diff", "--cached", "--quiet", "--", str(data)).returncode:
        return _refused(added)
    return _refused(_git("commit", "--quiet", "--message", message, "--", str(data)))


def _git(*words: str) -> subprocess.CompletedProcess[str]:
    command = ["git", "-C", str(deploy.REPOSITORY), *words]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def _refused(done: subprocess.CompletedProcess[str]) -> str:
    return f"{' '.join(done.args)}\n{done.stderr or done.stdout}" if done.returncode else ""
