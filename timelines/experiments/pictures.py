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
from matplotlib.image import imread

from contextpolicy.explain.palette import task_colors
from contextpolicy.simulation.drawing import INK, LANE, STYLE, draw_lanes, draw_shares, name_ends
from timelines.experiments import rates, tables
from timelines.experiments.configurations import (
    ALONE,
    CONFIGURATIONS,
    FACTORS,
    LINUX_GATED,
    STATIC_GATED,
    WEIGHTS_GATED,
)
from timelines.experiments.stories import CRITICAL
from timelines.experiments.tasks import TASKS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from timelines.experiments.evidence import Evidence
    from timelines.experiments.metrics import Run

WIDTH, ROW, PANEL = 9.0, 0.3, 2.4
"""Inches: a picture's width, the heights of a configuration's row and of a panel of curves."""
OTHERS = "#9aa3ad"
RIVALS = ("drive", "read")
"""The two contexts whose critical tasks want most."""
COMPARED = {LINUX_GATED.name: (OTHERS, 1.0), STATIC_GATED.name: (INK, 1.0), WEIGHTS_GATED.name: (None, 2.0)}
"""The colour and width of each configuration's response times; None is the task's colour."""


def draw_factors(evidence: Evidence, load: str, path: Path) -> bool:
    """Each context's critical task under each configuration: its hit rate with the interval over blocks."""
    found = tables.runs_of(evidence, load, [one.name for one in (*FACTORS, ALONE)])
    about = rates.by_context(run.schedule for runs in found.values() for run in runs)
    if not about:
        return False
    names = [CONFIGURATIONS[name].title for name in found]
    title = f"Inputs of each context's critical task that were done in time, {load} load"
    with _figure(ROW * len(names) + 1.3, title, path) as figure:
        panels: Any = figure.subplots(1, len(about), sharey=True, squeeze=False)[0]
        for panel, (context, task) in zip(panels, about.items(), strict=True):
            _dots(panel, list(found.values()), context, task)
        panels[0].set_yticks(range(len(names)), names)
        panels[0].set_ylim(len(names) - 0.5, -0.5)
        figure.supxlabel("% of what was due in the context, mean and 95 % interval over blocks", fontsize=9, color=INK)
    return True


def _dots(panel: Any, every: Sequence[Sequence[Run]], context: str, task: str) -> None:
    found = [(row, rates.critical(runs, context, task)) for row, runs in enumerate(every)]
    shown = [(row, one) for row, one in found if one]
    rows = [row for row, _ in shown]
    panel.hlines(rows, [100 * one.low for _, one in shown], [100 * one.high for _, one in shown], color=INK)
    panel.plot([100 * one.mean for _, one in shown], rows, "o", color=_color(task), markersize=6)
    panel.set_xlim(-3, 103)
    panel.set_title(f"{context}: {task}", fontsize=9)
    _plain(panel, "both")


def draw_responses(evidence: Evidence, load: str, path: Path) -> bool:
    """The part of what was due that was done within a time: what was never done keeps a curve below 100 %."""
    found = {name: runs for name, runs in tables.runs_of(evidence, load).items() if name in COMPARED}
    about = rates.by_context(run.schedule for runs in found.values() for run in runs)
    if not about:
        return False
    rows = (len(about) + 1) // 2
    title = f"Response times of each context's critical task, {load} load"
    with _figure(PANEL * rows + 0.6, title, path) as figure:
        panels: Any = figure.subplots(rows, 2, sharey=True, squeeze=False)
        for panel, (context, task) in zip(panels.flat, about.items(), strict=False):
            _curves(panel, found, context, task)
        for panel in panels.flat[len(about) :]:
            panel.remove()
        for panel in panels[:, 0]:
            panel.set_ylabel("% of what was due")
    return True


def _curves(panel: Any, found: Mapping[str, Sequence[Run]], context: str, task: str) -> None:
    measured = {name: rates.responses(runs, context, task) for name, runs in found.items()}
    last = max((times[-1] for times, _ in measured.values() if times), default=1.0)
    ends, colors = {}, {}
    for name, (times, due) in measured.items():
        heights = [100 * (number + 1) / due for number in range(len(times))]
        title, (color, width) = CONFIGURATIONS[name].title, COMPARED[name]
        ends[title], colors[title] = heights[-1] if heights else 0.0, color or _color(task)
        steps = [1000 * one for one in (*times, last)], [*heights, ends[title]]
        panel.step(*steps, where="post", color=colors[title], linewidth=width)
    panel.set_xscale("log")
    panel.xaxis.set_major_formatter("{x:g}")
    panel.set_ylim(0, 102)
    panel.set_title(f"{context}: {task}", fontsize=9)
    _deadline(panel, next(iter(found.values()))[0].schedule.deadlines.get(task))
    _plain(panel, "y")
    name_ends(panel, ends, colors, PANEL)


def _deadline(panel: Any, seconds: float | None) -> None:
    panel.set_xlabel("response time (ms)")
    if seconds:
        panel.axvline(1000 * seconds, color=INK, linewidth=0.8)
        words, place = f"deadline {1000 * seconds:g} ms", (1000 * seconds, 3)
        panel.annotate(words, place, (3, 0), textcoords="offset points", fontsize=7)


def draw_rivals(evidence: Evidence, path: Path) -> bool:
    """What static weights can do for one critical task, and what that leaves to another; a point for each set."""
    found = {name: _first_story(runs) for name, runs in evidence.searched.items() if runs}
    if not found:
        return False
    with _figure(PANEL * 1.4, "All static weights that were searched, on the first tuning story", path) as figure:
        panels: Any = figure.subplots(1, len(found), sharey=True, squeeze=False)[0]
        for panel, (name, runs) in zip(panels, found.items(), strict=True):
            _trade(panel, runs)
            panel.set_title(name, fontsize=9)
        panels[0].set_ylabel(_in_time(RIVALS[1]))
    return True


def _first_story(runs: Sequence[Run]) -> list[Run]:
    """Those of the story that all sets of weights ran."""
    return [run for run in runs if run.record.story == runs[0].record.story]


def _trade(panel: Any, runs: Sequence[Run]) -> None:
    one, other = ([100 * run.tally(CRITICAL[context], context).hit for run in runs] for context in RIVALS)
    panel.plot(one, other, "o", color=OTHERS, markeredgecolor=INK, markersize=6, alpha=0.8)
    panel.set_xlim(-3, 103)
    panel.set_ylim(-3, 103)
    panel.set_xlabel(_in_time(RIVALS[0]))
    _plain(panel, "both")


def _in_time(context: str) -> str:
    return f"{context}: {CRITICAL[context]}, % in time"


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
            panel.annotate(
                f"{one.mean:.2f}", (one.high, row), (4, 0), textcoords="offset points", va="center", fontsize=8
            )
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


def draw_film(run: Run, frames: Path, path: Path) -> None:
    """Figure 5c of the paper: what the camera sees, below the contexts that were due."""
    strip, lanes = imread(frames), _lanes(run)
    names = len({name for name, _, _ in lanes})
    seen = WIDTH * strip.shape[0] / strip.shape[1]
    with _figure(LANE * names + seen + 1.0, f"{run.record.story}: contexts, and what the camera sees", path) as figure:
        panels: Any = figure.subplots(2, 1, sharex=True, height_ratios=[LANE * names, seen])
        panels[1].imshow(strip, cmap="gray", extent=(0, run.schedule.duration, 0, 1), aspect="auto")
        panels[1].set_yticks([])
        draw_lanes(panels[0], lanes)
        panels[1].set_xlabel("time (s)")


def draw_use(run: Run, path: Path) -> None:
    """Figure 7 of the paper: what each task used over time, with the contexts that were due."""
    used = {
        task: [(float(at), (after - before) / 1000) for at, (before, after) in enumerate(pairwise(own))]
        for task, own in run.record.used.items()
        if task in run.schedule.inputs
    }
    title = f"{CONFIGURATIONS[run.record.configuration].title}, {run.record.story}: CPU used over time"
    draw_shares(used, _lanes(run), path, until=run.schedule.duration, label="CPU used (cores)", title=title)


def _part(tasks: Mapping[str, Sequence[float]], task: str) -> float:
    whole = sum(weight for weight, _ in tasks.values())
    return tasks[task][0] / whole if whole else 0.0


def _lanes(run: Run) -> list[tuple[str, float, float]]:
    """The contexts by the timeline, in the same order in every picture."""
    return sorted((name, one.begin, one.end) for one in run.schedule.windows for name in one.contexts)


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
