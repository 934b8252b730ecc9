"""The report's tables, as Markdown. Pure."""

from __future__ import annotations

from statistics import median
from typing import TYPE_CHECKING

from timelines.experiments import goals, installation, measures, prediction
from timelines.experiments.goals import CRITICAL
from timelines.experiments.intervals import of_ratios, short, spread
from timelines.experiments.measures import Fate

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from timelines.experiments.goals import Verdict
    from timelines.experiments.measures import Response
    from timelines.experiments.raw_data import RunData
    from timelines.experiments.series import Series

NONE = "-"
_WORDS = {True: "met", False: "**missed**", None: "unsure"}


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [list(head), ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def goal_table(found: Iterable[Verdict]) -> str:
    """Each goal, what was measured, and whether it is met."""
    return table(["goal", "measured", ""], [[one.goal, one.measured, _WORDS[one.met]] for one in found])


def overview(series: Series) -> str:
    """Total time and what it was spent on, by configuration."""
    rows = []
    for name in series.runs:
        own = series.of(name)
        fates = [measures.counts(run, task) for run in own for task in run.inputs]
        times = [moment * 1000 for run in own for moment in measures.reactions(run)]
        rows.append(
            [
                own[0].title,
                over(own, measures.total_time, "s"),
                _ratio(series, name, goals.speedup),
                _ratio(series, name, goals.on_equal_work),
                *(f"{sum(count[fate] for count in fates) / len(own):.0f}" for fate in Fate),
                f"{median(times):.0f} ms ({len(times)})" if times else NONE,
                *(over(own, cpu_of(container), "s") for container in installation.CONTROL),
                _others(own),
            ]
        )
    head = ["", "total time", "speedup", "on equal work", *(f"inputs {fate}" for fate in Fate), "sample to cgroup"]
    return table([*head, *(f"CPU of the {name}" for name in installation.CONTROL), "CPU of all else"], rows)


def _others(runs: Sequence[RunData]) -> str:
    """Kubernetes carries out what is decided: what that takes shows in the difference between configurations."""
    found = [measures.cpu_of_others(run, [*run.inputs, *installation.CONTROL]) for run in runs]
    known = [seconds for seconds in found if seconds is not None]
    return f"{spread(known)} s" if known else NONE


def critical(series: Series) -> str:
    """How the critical task answers while the robot moves and while it stands."""
    rows = []
    for name in series.runs:
        own = series.of(name)
        cells = [own[0].title]
        for moving in (True, False):
            cells += _response([measures.response(run, CRITICAL, moving=moving) for run in own])
        ratios = [measures.over_ideal(series.ideal, run, CRITICAL, moving=True) for run in own] if series.ideal else []
        known = [ratio for ratio in ratios if ratio]
        rows.append([*cells, f"{of_ratios(known)} x" if known else NONE])
    states = [f"{what}, robot {state}" for state in ("moves", "stands") for what in ("p50", "p99", "missed", "due")]
    return table(["", *states, "p50 over the ideal's, robot moves"], rows)


def tasks(series: Series) -> str:
    """What became of each task's inputs."""
    rows = []
    for task in series.first.inputs:
        for name in series.runs:
            own = series.of(name)
            fates = [measures.counts(run, task) for run in own]
            p50, p99, missed, _ = _response([measures.response(run, task) for run in own])
            counts = [f"{median(count[fate] for count in fates):.0f}" for fate in Fate]
            ends = [end for run in own if (end := measures.task_time(run, task)) is not None]
            done = f"{spread(ends)} s" if ends else NONE
            rows.append([task, own[0].title, *counts, done, p50, p99, missed, over(own, cpu_of(task), "s")])
    return table(["task", "", *Fate, "done after", "p50", "p99", "missed", "CPU"], rows)


def accuracies(series: Series) -> str:
    """How right each task was, a column each."""
    judged = [task for task in series.first.inputs if any(task in one for one in series.accuracies.values())]
    head, rows = [""], []
    for task in judged:
        first = next(one[task] for one in series.accuracies.values() if task in one)
        head.append(f"{task}: {first.measure} ({first.unit})")
    for name in series.runs:
        cells = []
        for task in judged:
            found = [own[task] for run in series.of(name) if task in (own := series.accuracies[run])]
            cells.append(f"{spread([one.value for one in found])} of {found[0].count}" if found else NONE)
        rows.append([series.of(name)[0].title, *cells])
    return table(head, rows)


def predictions(series: Series) -> str:
    """What `simulate --profiles` says of each decided run, beside what was measured; empty if there is none."""
    rows = []
    for run in series.each():
        for one in prediction.compare(run, series.folders[run]):
            off = 100 * (one.p50[0] / one.p50[1] - 1)
            apart = 100 * (one.misses[0] - one.misses[1])
            p50 = [f"{short(1000 * value)} ms" for value in one.p50]
            part = [f"{short(100 * value)} %" for value in one.misses]
            rows.append([run.title, one.task, *p50, f"{off:+.0f} %", *part, f"{apart:+.1f}"])
    head = ["", "task", "p50 predicted", "measured", "off by", "misses predicted", "measured", "points apart"]
    return table(head, rows) if rows else ""


def cpu_of(container: str) -> Callable[[RunData], float]:
    """CPU seconds that a container used."""
    return lambda run: measures.cpu_seconds(run, container)


def over(runs: Sequence[RunData], measure: Callable[[RunData], float], unit: str) -> str:
    """A measure over repeats."""
    return f"{spread([measure(run) for run in runs])} {unit}"


def _ratio(series: Series, name: str, compare: Callable[[RunData, RunData], float]) -> str:
    values = series.paired(name, compare)
    return f"{of_ratios(values)} x" if values else NONE


def _response(found: Sequence[Response]) -> list[str]:
    medians = [one.p50 * 1000 for one in found if one.p50 is not None]
    tails = [one.p99 * 1000 for one in found if one.p99 is not None]
    return [
        f"{spread(medians)} ms" if medians else NONE,
        f"{spread(tails)} ms" if tails else NONE,
        f"{spread([one.misses * 100 for one in found])} %",
        f"{median(one.due for one in found):.0f}",
    ]
