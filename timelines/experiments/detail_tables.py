"""The tables of the details, as Markdown. Pure."""

from __future__ import annotations

from collections import defaultdict
from statistics import fmean, median
from typing import TYPE_CHECKING, Any

from timelines.experiments import rates
from timelines.experiments.accounting import Ending
from timelines.experiments.blocks import HEAVY
from timelines.experiments.capacity import Capacity
from timelines.experiments.configurations import CONFIGURATIONS, LINUX, requests
from timelines.experiments.tables import NONE, all_runs, gain, percent, runs_of, short, table

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from timelines.experiments.evidence import Evidence
    from timelines.experiments.metrics import Run
    from timelines.experiments.paired import Interval
    from timelines.experiments.record import Record
    from timelines.experiments.verdicts import Verdict

MISSES = 0.05
"""Tasks that keep their deadlines anyway are easily predicted: these miss more, as measured or under Linux default."""


def calibrated(frozen: Mapping[str, Any], cores: int) -> str:
    """What each task wants and keeps alone, the static weights that were found, and what contexts need.

    `cores` are the node's, of which pods request a part in proportion to their static weights.
    """
    searches = ("ungated", "gated", "ungated-at-1.26")
    tuned = {name: frozen.get("tuned", {}).get(name, {}).get("weights", {}) for name in searches}
    rows = [
        [
            task,
            short(wanted),
            f"{1000 * frozen['deadlines'][task]:.0f} ms",
            f"{100 * frozen['solo'][task]:.1f} %",
            *(_weight(weights, task, cores) for weights in tuned.values()),
        ]
        for task, wanted in frozen["wanted"].items()
    ]
    head = ["task", "processors wanted", "deadline", "kept alone", "static weight", "gated", "at lighter loads"]
    needs = ", ".join(f"{context} {short(needed)}" for context, needed in frozen["needs"].items())
    return f"{table(head, rows)}\nProcessors that critical and protected tasks want together, by context: {needs}.\n"


def _weight(weights: Mapping[str, int], task: str, cores: int) -> str:
    """The weight that was found, and the request that it became: none is less than a pod's least."""
    return f"{weights[task]} ({requests(weights, cores)[task]})" if task in weights else NONE


def endings(evidence: Evidence, load: str) -> str:
    """How the inputs of every task ended, in percent of what was due, whether its context wants it or not."""
    rows = []
    for name, runs in runs_of(evidence, load).items():
        for task in runs[0].schedule.inputs:
            counts = rates.endings(runs, task)
            due = sum(counts.values())
            parts = [f"{100 * counts[ending] / due:.1f}" if due else NONE for ending in Ending]
            wanted = percent(rates.whole(runs, task))
            rows.append([task, CONFIGURATIONS[name].title, f"{due:.0f}", *parts, wanted])
    return table(["task", "", "due", *Ending, "hit, of those wanted"], sorted(rows, key=lambda row: row[0]))


def onsets(evidence: Evidence, load: str) -> str:
    """The critical task at the begin of its context, and after it."""
    rows = []
    for name, runs in runs_of(evidence, load).items():
        for context, task in rates.by_context(run.schedule for run in runs).items():
            found = rates.onset(runs, context, task)
            if found:
                rows.append([CONFIGURATIONS[name].title, f"{context}: {task}", *(f"{100 * one:.1f}" for one in found)])
    return table(["", "", "first second", "after it"], rows)


def accuracies(evidence: Evidence, load: str) -> str:
    """How right each task was, and of how many of SLAM's frames that are wanted it trusts the pose: over blocks."""
    rows = []
    for name, runs in runs_of(evidence, load).items():
        for task, (measure, unit) in _judged(runs).items():
            interval, count = rates.right(runs, task), sum(task in one.record.accuracy for one in runs)
            rows.append([f"{task}: {measure}", CONFIGURATIONS[name].title, f"{_around(interval)} {unit}", str(count)])
        if poses := rates.covered(runs, "slam"):
            cell = f"{percent(poses)} %"
            rows.append(["slam: poses that it trusts", CONFIGURATIONS[name].title, cell, str(len(runs))])
    return table(["", "", "mean", "runs"], sorted(rows, key=lambda row: row[0]))


def _around(found: Interval | None) -> str:
    return f"{short(found.mean)} [{short(found.low)}, {short(found.high)}]" if found else NONE


def _judged(runs: Sequence[Run]) -> Mapping[str, tuple[str, str]]:
    return {task: (one[0], one[2]) for run in runs for task, one in run.record.accuracy.items()}


def player(evidence: Evidence, load: str) -> str:
    """How late the player was itself, and how busy the machine was before."""
    rows = []
    for name, runs in runs_of(evidence, load).items():
        middle, most = rates.lateness(runs)
        busiest = max(run.record.about["load"] for run in runs)
        rows.append([CONFIGURATIONS[name].title, f"{middle:.1f} ms", f"{most:.1f} ms", f"{100 * busiest:.0f} %"])
    return table(["", "player late, median", "99 %", "busiest before a run"], rows)


def paces(evidence: Evidence) -> str:
    """How much of a whole processor's pace each of the tasks' should do, and what slowed it says that it did."""
    every = all_runs(evidence)
    found = []
    for load, (processors, part) in evidence.frozen["loads"].items():
        left = [part * one.about["pace"]["left"] for one in every if one.load == load]
        if left:
            found.append(f"{load} load {Capacity(processors, part)} (measured: {fmean(left):.3f})")
    return f"Processors, and the part of a whole one's pace that each has: {', '.join(found)}.\n"


def measures(evidence: Evidence) -> str:
    """What the machine was measured to do, and how far off the speed was that limits follow from. Empty without any."""
    found: dict[float, list[Record]] = {}
    for record in all_runs(evidence):
        if "expected" in record.about and CONFIGURATIONS[record.configuration].control == "Limit":
            found.setdefault(record.about["whole"], []).append(record)
    rows = []
    for whole, runs in found.items():
        off = sorted(_counted_on(one) for one in runs)
        spread = f"{median(off):.2f} ({off[0]:.2f} to {off[-1]:.2f})"
        first = min(one.about["date"][:10] for one in runs)
        rows.append([first, f"{whole:.0f}", spread, str(len(runs))])
    head = ["", "a whole processor, turns a second"]
    head += ["speed that limits counted on, of that in the run: median (range)", "runs under limits"]
    return table(head, sorted(rows)) if rows else ""


def _counted_on(record: Record) -> float:
    """The speed that was expected of the processors, as a part of what it was in the run."""
    return float(record.about["expected"] / record.about["pace"]["speed"])


def predictions(evidence: Evidence) -> str:
    """Misses as predicted before the runs, as measured, and as under Linux default; then how far off each answer is."""
    rows, every, missing = [], [], defaultdict(list)
    for story, configurations in evidence.frozen.get("predicted", {}).get("misses", {}).items():
        plain = evidence.of(HEAVY, story, LINUX.name)
        for name, tasks in configurations.items():
            runs = evidence.of(HEAVY, story, name)
            for task, predicted in tasks.items() if runs and plain else ():
                missed, before = (1 - _hit(one, task) for one in (runs, plain))
                points = [100 * abs(answer - missed) for answer in (predicted, 0.0, before)]
                every.append(points)
                if max(missed, before) > MISSES:
                    missing[name].append(points)
                values = (f"{100 * one:.1f}" for one in (predicted, missed, before))
                rows.append([story, CONFIGURATIONS[name].title, task, *values])
    if not rows:
        return ""
    head = ["story", "", "task", "misses predicted, %", "measured", "under Linux default"]
    means = [["of all", *_means(every)]]
    means += [
        [f"{CONFIGURATIONS[name].title}, where over {100 * MISSES:g} % are missed, here or there", *_means(points)]
        for name, points in missing.items()
    ]
    score = table(["points off on average", "the prediction", "always 0 %", "as under Linux default"], means)
    return f"{table(head, rows)}\n{score}"


def _means(rows: Sequence[Sequence[float]]) -> Iterator[str]:
    """Each column's mean; nothing where there is no row."""
    return (f"{fmean(column):.1f}" for column in zip(*rows, strict=True))


def _hit(runs: Sequence[Run], task: str) -> float:
    found = rates.whole(runs, task)
    return found.mean if found else 1.0


def cases(verdict: Verdict) -> str:
    """Each case of a goal: both values, by how much it is better than asked, and its own probability."""
    rows = [
        [one.name, short(one.value), short(one.base), gain(one.gain), f"{one.probability:.3g}"] for one in verdict.cases
    ]
    return table(["", "value", "against", "margin", "p"], rows)
