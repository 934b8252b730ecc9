"""What is found out before the first block, and then frozen: how slow the processors are, deadlines, static weights."""

from __future__ import annotations

import datetime as dt
from typing import TYPE_CHECKING, Any

from contextpolicy.simulation.profiles import parse_profiles
from contextpolicy.streams.timeline import load
from timelines.experiments import calibration, installation
from timelines.experiments.blocks import HEAVY, LIGHT, PAPERS_LOAD, PLAN, SWEEP, UNSLOWED, Trial, seconds_left
from timelines.experiments.capacity import Capacity
from timelines.experiments.configurations import ALONE, STATIC, STATIC_GATED
from timelines.experiments.evidence import ENDING, PREPARED, SEARCH, SEARCHES, write_schedule
from timelines.experiments.halving import candidates, halved
from timelines.experiments.machine import kind, this_machine, whole_here
from timelines.experiments.metrics import Run
from timelines.experiments.predictions import predict, slowed_down
from timelines.experiments.record import RecordError, block, records, write_whole
from timelines.experiments.stories import HELD_OUT, STORIES, TUNING
from timelines.experiments.workbench import Setting, own_deadlines

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

    from timelines.experiments.campaign import Progress
    from timelines.experiments.halving import Weights
    from timelines.experiments.record import Record
    from timelines.experiments.stories import Story
    from timelines.experiments.workbench import Workbench

    Frozen = Mapping[str, Any]

CALIBRATION = "alone"
"""File of the calibration's runs, which are of each task alone."""
MACHINE = "machine-"
"""How the names of files begin whose runs show what a whole processor is."""
PROFILED = "profiled"
"""Folder of the run that predictions take each input's cost from."""
MIDDLE = "exp2"
"""The paper's story of which it is measured what its tasks want."""
UNCALIBRATED: Mapping[str, Capacity] = {
    LIGHT: Capacity(2, 1.0),
    HEAVY: Capacity(1, 0.8),
    PAPERS_LOAD: Capacity(1, 0.5),
}
"""What the tasks share where nothing was calibrated: for a quick look only."""


LIGHTER = "ungated-at-1.26"
"""An earlier search of static weights: what is best where tasks want more is not best where they want less. It is not
repeated: where its result is not frozen, lighter loads have the weights of the heavy one."""
LIGHTER_LOADS = (LIGHT, *SWEEP[:2])
"""Those that its weights are played under."""


class OutOfTimeError(Exception):
    """No time is left for the next run."""


class Preparation:
    """Calibrates and tunes on the tuning stories; runs that are finished are not repeated.

    OutOfTimeError from everything that would begin a run where `until` says that so many seconds are not left.
    """

    def __init__(self, bench: Workbench, progress: Progress, until: Callable[[float], bool]) -> None:
        self._bench, self._progress, self._until = bench, progress, until

    def calibrated(self) -> dict[str, Any]:
        """What the tasks share under each load, and deadlines that each task keeps alone."""
        own = own_deadlines()
        cores = installation.cores()
        whole = Setting(Capacity(cores, 1.0), own)
        alone, papers = self._alone(whole, TUNING), self._alone(whole, [STORIES[MIDDLE]])
        wanted, needs = calibration.demand(alone), calibration.neediest(alone)
        runs = {LIGHT: alone, HEAVY: alone, PAPERS_LOAD: papers}
        loads = {load: calibration.of_load(load, every, cores) for load, every in runs.items()}
        asked = {load: calibration.asked(every, loads[load], cores) for load, every in runs.items()}
        shared = ", ".join(f"{name} {capacity}" for name, capacity in loads.items())
        self._progress.say(f"wanted: {_words(wanted, 'processors')}; they get: {shared}")
        self._progress.say(f"wanted by critical and protected tasks: {_words(needs, 'processors')}")
        slow = self._alone(Setting(loads[HEAVY], own), TUNING)
        self._keep(CALIBRATION, [*alone, *papers, *slow])
        ended = {task: [end for run in slow for end in run.ended(task)] for task in own}
        deadlines = {task: calibration.deadline(own[task], ended[task]) for task in own}
        solo = {task: calibration.solo(deadlines[task], ended[task]) for task in own}
        self._progress.say(f"deadlines: {_words(deadlines, 's')}; kept alone: {_words(solo)}")
        date = dt.datetime.now(tz=dt.UTC).isoformat(timespec="seconds")
        found = {"wanted": wanted, "needs": needs, "loads": loads, "asked": asked}
        return {"date": date, **found, "deadlines": deadlines, "solo": solo}

    def measured(self, frozen: Frozen) -> None:
        """Measure what counts as a whole processor here, unless enough runs on such a machine have shown it."""
        setting = settings(frozen)[HEAVY]
        reference, known = self._reference(setting), self._on_such_a_machine(setting)

        def play(whole: float) -> Run:
            self._bench.whole = whole
            number = len(self._machine_files()) + 1
            run = self._each_alone(setting, TUNING[0], f"machine/{number:02}")
            self._keep(f"{MACHINE}{number:02}", [run])
            return run

        self._bench.whole = whole_here(reference, known, play)
        self._progress.say(f"here a whole processor is {self._bench.whole:.0f} turns a second")

    def _on_such_a_machine(self, setting: Setting) -> list[Run]:
        """The runs that have shown what a whole processor is on machines like this one."""
        here = kind(this_machine())
        due = self._bench.schedule(TUNING[0], setting.deadlines)
        every = (one for path in self._machine_files() for one in records(path.read_bytes()))
        return [Run(due, one) for one in every if kind(one.about["machine"]) == here]

    def _machine_files(self) -> list[Path]:
        return sorted((self._bench.folders.data / PREPARED).glob(f"{MACHINE}*{ENDING}"))

    def tuned(self, frozen: Frozen, *, gated: bool) -> dict[str, Any]:
        """The static weights that the search found, and what it tried."""
        self.measured(frozen)
        setting = settings(frozen)[HEAVY]
        configuration = STATIC_GATED if gated else STATIC
        done: list[Run] = []

        def run(number: int, weights: Weights, story: str) -> Run:
            self._progress.say(f"{configuration.title}, set {number + 1}: {story}")
            trial = Trial(HEAVY, STORIES[story], configuration, 0, number)
            record = self._record(f"tuning/{setting.capacity.name}/{number + 1:02}", trial, setting, weights)
            done.append(Run(self._bench.schedule(trial.story, setting.deadlines), record))
            return done[-1]

        tries = candidates(priorities(), frozen["wanted"], frozen["deadlines"])
        found = halved(tries, [story.name for story in TUNING], run)
        self._keep(f"{SEARCH}{name(gated=gated)}", done)
        for story in TUNING:
            write_schedule(
                self._bench.folders.data / PREPARED, story.name, self._bench.schedule(story, setting.deadlines)
            )
        return {"weights": found[0].weights, "tried": [list(one) for one in found]}

    def predicted(self, frozen: Frozen) -> dict[str, Any]:
        """What is predicted of each held-out story, and the profiles that this is computed from."""
        self.measured(frozen)
        setting = settings(frozen)[HEAVY]
        run = self._each_alone(setting, TUNING[0], PROFILED)
        profiles = self._bench.profiles(PROFILED, _alone(TUNING[0]))
        slow, misses = slowed_down(parse_profiles(profiles), setting.capacity.part / run.speed), {}
        for story in HELD_OUT:
            policy, timeline = installation.policy_document(story), load(self._bench.folders.timeline(story))
            due = self._bench.schedule(story, setting.deadlines)
            misses[story.name] = predict(policy, timeline, due, slow, setting.capacity)
        return {"misses": misses, "profiles": profiles}

    def _alone(self, setting: Setting, stories: Sequence[Story]) -> list[Run]:
        return [self._each_alone(setting, story, f"calibration/{setting.capacity.name}") for story in stories]

    def _each_alone(self, setting: Setting, story: Story, place: str) -> Run:
        self._progress.say(f"each task alone on {setting.capacity} processors: {story.name}")
        record = self._record(place, _alone(story), setting, {})
        return Run(self._bench.schedule(story, setting.deadlines), record)

    def _reference(self, setting: Setting) -> Run:
        """The calibration's run of the story that machines are compared by; RecordError where its file has none."""
        path = self._bench.folders.data / PREPARED / f"{CALIBRATION}{ENDING}"
        for one in records(path.read_bytes()) if path.exists() else ():
            if one.story == TUNING[0].name and Capacity(*one.about["capacity"]) == setting.capacity:
                return Run(self._bench.schedule(TUNING[0], setting.deadlines), one)
        raise RecordError(f"{path}: no run of {TUNING[0].name} on {setting.capacity}: calibrate again")

    def _keep(self, what: str, runs: Iterable[Run]) -> None:
        path = self._bench.folders.data / PREPARED / f"{what}{ENDING}"
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, block(run.record for run in runs))

    def _record(self, place: str, trial: Trial, setting: Setting, weights: Weights) -> Record:
        if not self._bench.has(place, trial) and not self._until(seconds_left(self._bench.took, [trial])):
            raise OutOfTimeError
        return self._bench.record(place, trial, setting, weights)


def _alone(story: Story) -> Trial:
    return Trial(HEAVY, story, ALONE, 0, 0)


def settings(frozen: Frozen) -> dict[str, Setting]:
    """What was frozen for each load, or what does for a quick look."""
    loads = {name: Capacity(*capacity) for name, capacity in frozen.get("loads", UNCALIBRATED).items()}
    asked = frozen.get("asked", calibration.LOADS)[HEAVY]
    loads |= {load: calibration.swept(load, loads[HEAVY], asked) for load in SWEEP}
    loads[UNSLOWED] = Capacity(installation.cores(), 1.0)
    return {name: Setting(capacity, frozen.get("deadlines") or own_deadlines()) for name, capacity in loads.items()}


def tuned_weights(frozen: Frozen) -> dict[str, dict[bool, Weights]]:
    """The searched weights of each load, without and with gating; those by priority where nothing was searched."""
    by_priority = candidates(priorities(), {}, {})[1]
    own = {what: found["weights"] for what, found in frozen.get("tuned", {}).items()}
    heavy = {gated: own.get(name(gated=gated), by_priority) for gated in (False, True)}
    lighter = heavy | ({False: own[LIGHTER]} if LIGHTER in own else {})
    return {part.load: lighter if part.load in LIGHTER_LOADS else heavy for part in PLAN}


def name(*, gated: bool) -> str:
    """Under which name searched weights are frozen."""
    return SEARCHES[gated]


def priorities() -> dict[str, float]:
    """Each task's priority in the policy of the stories."""
    tasks = installation.policy_document(TUNING[0])["spec"]["tasks"]
    return {task["name"]: float(task.get("priority", 1)) for task in tasks}


def _words(values: Mapping[str, float], unit: str = "") -> str:
    return ", ".join(f"{name} {value:.3g} {unit}".rstrip() for name, value in values.items())
