"""The report's pictures, as SVG: the paper's Figures 5 to 7 again, the factors, and response times.

A task has the same colour in every picture, and so has a context. The ground is transparent, and text stands out from a
white page and from a dark one.
"""

from __future__ import annotations

from contextlib import contextmanager
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib.figure import Figure

from contextpolicy.explain.task_colors import task_colors
from contextpolicy.simulation.drawing import INK, STYLE, draw_shares
from timelines.demo.deploy import TASKS
from timelines.experiments import rates, tables
from timelines.experiments.configurations import CONFIGURATIONS, LINUX_GATED, STATIC_GATED, WEIGHTS_GATED
from timelines.scenarios import mission

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from timelines.experiments.evidence import Evidence
    from timelines.experiments.metrics import Run

WIDTH, ROW, PANEL = 9.0, 0.62, 2.8
"""Inches: a picture's width, the height of a configuration's bars, and of a panel of curves."""
BAR = 0.2
COMPARED = {LINUX_GATED.name: ":", STATIC_GATED.name: "--", WEIGHTS_GATED.name: "-"}
"""The line of each configuration whose response times are drawn: configurations have no colours, tasks have."""
OTHERS = "#9aa3ad"


def draw_factors(evidence: Evidence, load: str, path: Path) -> bool:
    """Each context's critical task under each configuration: its hit rate with the interval over blocks."""
    found = tables.runs_of(evidence, load)
    about = rates.by_context(run.schedule for runs in found.values() for run in runs)
    if not about:
        return False
    names = [CONFIGURATIONS[name].title for name in found]
    title = f"Inputs of the critical task that were done in time, {load} load"
    with _figure(ROW * len(names) + 1.3, title, path) as figure:
        panel: Any = figure.subplots()
        for place, (context, task) in enumerate(about.items()):
            _bars(panel, list(found.values()), context, task, (place - (len(about) - 1) / 2) * BAR)
        panel.set_yticks(range(len(names)), names)
        panel.set_ylim(len(names) - 0.5, -0.5)
        panel.set_xlim(0, 100)
        panel.set_xlabel("% of what was due in the task's context; the line is the 95 % interval over blocks")
        _plain(panel, "x")
        figure.legend(loc="outside lower center", ncols=len(about), frameon=False)
    return True


def _bars(panel: Any, every: Sequence[Sequence[Run]], context: str, task: str, offset: float) -> None:
    found = [(row, rates.critical(runs, context, task)) for row, runs in enumerate(every)]
    shown = [(row + offset, one) for row, one in found if one]
    places = [row for row, _ in shown]
    means = [100 * one.mean for _, one in shown]
    panel.barh(places, means, height=BAR, color=_color(task), label=f"{context}: {task}")
    low, high = [100 * one.low for _, one in shown], [100 * one.high for _, one in shown]
    panel.hlines(places, low, high, color=INK, linewidth=1)


def draw_responses(evidence: Evidence, load: str, path: Path) -> bool:
    """The part of what was due that was done within a time: what was never done keeps a curve below 100 %."""
    found = {name: runs for name, runs in tables.runs_of(evidence, load).items() if name in COMPARED}
    about = rates.by_context(run.schedule for runs in found.values() for run in runs)
    if not about:
        return False
    with _figure(PANEL + 1.1, f"Response times of each context's critical task, {load} load", path) as figure:
        panels: Any = figure.subplots(1, len(about), sharey=True, squeeze=False)[0]
        for panel, (context, task) in zip(panels, about.items(), strict=True):
            _curves(panel, found, context, task)
        panels[0].set_ylabel("% of what was due")
        panels[0].set_ylim(0, 101)
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(found), frameon=False)
    return True


def _curves(panel: Any, found: Mapping[str, Sequence[Run]], context: str, task: str) -> None:
    deadline = next(iter(found.values()))[0].schedule.deadlines.get(task)
    for name, runs in found.items():
        times, due = rates.responses(runs, context, task)
        if times:
            heights = [100 * (number + 1) / due for number in range(len(times))]
            label, color = CONFIGURATIONS[name].title, _color(task) if COMPARED[name] == "-" else OTHERS
            panel.step([1000 * one for one in times], heights, COMPARED[name], where="post", label=label, color=color)
    if deadline:
        panel.axvline(1000 * deadline, color=INK, linewidth=0.8)
        panel.annotate("deadline", (1000 * deadline, 3), xytext=(3, 0), textcoords="offset points", fontsize=7)
    panel.set_xscale("log")
    panel.set_title(f"{context}: {task}", fontsize=9)
    panel.set_xlabel("ms")
    _plain(panel, "both")


def draw_speedups(evidence: Evidence, path: Path) -> bool:
    """Figure 6 of the paper: total time against Linux default, story by story."""
    rows = list(tables.speedups(evidence))
    if not rows:
        return False
    with _figure(0.4 * len(rows) + 1.2, "Total time of Linux default divided by it (paper's Figure 6)", path) as figure:
        panel: Any = figure.subplots()
        for row, (_, _, one) in enumerate(rows):
            panel.barh(row, one.mean, height=0.6, color=OTHERS)
            panel.hlines(row, one.low, one.high, color=INK, linewidth=1)
        panel.axvline(1, color=INK, linewidth=0.8)
        panel.set_yticks(range(len(rows)), [f"{story}, {title}" for story, title, _ in rows])
        panel.set_ylim(len(rows) - 0.5, -0.5)
        panel.set_xlim(left=0)
        panel.set_xlabel("times as fast")
        _plain(panel, "x")
    return True


def draw_decisions(run: Run, path: Path) -> None:
    """Figure 5 of the paper: weights and shares over time, with the contexts."""
    steps = [(at / 1000, tasks) for at, _, tasks in run.record.plans]
    shares = {task: [(at, tasks[task][1] / 1000) for at, tasks in steps] for task in run.schedule.inputs}
    weights = {task: [(at, _part(tasks, task)) for at, tasks in steps] for task in run.schedule.inputs}
    title = f"{CONFIGURATIONS[run.record.configuration].title}, {run.record.story}: weights and shares"
    draw_shares(shares, _lanes(run), path, until=run.schedule.duration, weights=weights, title=title)


def draw_use(run: Run, path: Path) -> None:
    """Figure 7 of the paper: what each task used over time, with the contexts that were due."""
    used = {
        task: [(float(at), (after - before) / 1000) for at, (before, after) in enumerate(pairwise(own))]
        for task, own in run.record.used.items()
        if task in run.schedule.inputs
    }
    title = f"{CONFIGURATIONS[run.record.configuration].title}, {run.record.story}: CPU used over time"
    draw_shares(used, _lanes(run), path, until=run.schedule.duration, unit="cores used", title=title)


def _part(tasks: Mapping[str, Sequence[float]], task: str) -> float:
    whole = sum(weight for weight, _ in tasks.values())
    return tasks[task][0] / whole if whole else 0.0


def _lanes(run: Run) -> list[tuple[str, float, float]]:
    """The contexts by the timeline. All kinds come first, empty, so that each has its own colour in every picture."""
    shown = [(name, one.begin, one.end) for one in run.schedule.windows for name in one.contexts]
    return [*((kind, 0.0, 0.0) for kind in mission.KINDS), *shown]


def _color(task: str) -> str:
    """The colour that the task has in every picture of the experiments."""
    return task_colors(TASKS)[task]


@contextmanager
def _figure(height: float, title: str, path: Path) -> Iterator[Figure]:
    """An empty picture that is saved at the end, without a date: the same runs give the same file."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, height), layout="constrained")
        yield figure
        figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
        figure.savefig(path, metadata={"Date": None})


def _plain(panel: Any, grid: str) -> None:
    panel.spines[["top", "right"]].set_visible(False)
    panel.grid(axis=grid, color=INK, alpha=0.25, linewidth=0.6)
    panel.set_axisbelow(True)
