"""The report's pictures, in the manner of the paper's Figures 5 to 7, as SVG."""

from __future__ import annotations

from contextlib import contextmanager
from statistics import median
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from contextpolicy.explain.task_colors import task_colors
from contextpolicy.simulation.drawing import INK, STYLE, draw_shares
from timelines.demo.deploy import TASKS
from timelines.experiments import measures
from timelines.experiments.intervals import short

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from timelines.experiments.intervals import Interval
    from timelines.experiments.raw_data import RunData

WIDTH, ROW = 9.0, 0.3
"""Inches: the picture's width, and the height of a row."""
BAR = "#9aa3ad"
"""Configurations are not tasks, so they have none of the tasks' colours."""
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.99)


def draw_misses(values: Mapping[str, Sequence[float]], path: Path, *, task: str, title: str) -> None:
    """A bar for each configuration: the median of its percentages, with a whisker from least to greatest."""
    with _rows(list(values), path, title) as panel:
        for row, own in enumerate(values.values()):
            middle = median(own)
            around = [[middle - min(own)], [max(own) - middle]]
            panel.barh(row, middle, xerr=around, color=_color(task), height=0.62, ecolor=INK)
            _label(panel, f"{middle:.3g} %", max(own), row)
        panel.set_xlabel("% of the inputs that were due")
        panel.set_xlim(left=0)


def draw_speedups(values: Mapping[str, Mapping[str, Interval]], path: Path) -> None:
    """Figure 6: for each series a group of bars, a configuration each, with the interval; 1 is Linux default."""
    names = [line for series, own in values.items() for line in (f"{series}:", *own)]
    headings = [place for place, name in enumerate(names) if name.endswith(":")]
    found = [line for own in values.values() for line in (None, *own.values())]
    with _rows(names, path, "Speedup in total time over Linux default") as panel:
        panel.axvline(1, color=INK, linewidth=0.8, zorder=0)
        for row, interval in enumerate(found):
            if interval is not None:
                low, high = (interval.middle if end is None else end for end in (interval.low, interval.high))
                around = [[interval.middle - low], [high - interval.middle]]
                panel.barh(row, interval.middle, xerr=around, color=BAR, height=0.62, ecolor=INK)
                _label(panel, f"{interval.middle:.2f}x", high, row)
        for heading in headings:
            panel.get_yticklabels()[heading].set_fontweight("bold")
        panel.set_xlabel("times as fast as Linux default (1)")


def draw_responses(
    times: Mapping[str, Sequence[float]], path: Path, *, task: str, title: str, deadline: float | None
) -> None:
    """A row for each configuration: QUANTILES of its response times, which ascend, in seconds; and the deadline."""
    with _rows(list(times), path, title) as panel:
        if deadline:
            panel.axvline(1000 * deadline, color=INK, linewidth=0.8, zorder=0)
            _label(panel, f"deadline {1000 * deadline:g} ms", 1000 * deadline, -0.6)
        for row, own in enumerate(times.values()):
            if own:
                least, low, middle, high, most = (1000 * own[int(part * (len(own) - 1))] for part in QUANTILES)
                panel.plot([least, most], [row, row], color=_color(task), linewidth=1.2)
                panel.plot([low, high], [row, row], color=_color(task), linewidth=6, solid_capstyle="butt")
                panel.plot([middle], [row], color=INK, marker="|", markersize=14, markeredgewidth=2)
                _label(panel, f"{short(middle)} ms", most, row)
        panel.set_xscale("log")
        panel.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        panel.xaxis.set_major_formatter("{x:g}")
        panel.xaxis.set_minor_locator(NullLocator())
        panel.set_xlabel("response time (ms): 5 %, 25 %, median, 75 %, 99 % of the answers")


@contextmanager
def _rows(names: Sequence[str], path: Path, title: str) -> Iterator[Any]:
    """A panel with a named row for each configuration, the first on top; saved at the end."""
    with _figure(ROW * len(names) + 1.1, title, path) as figure:
        panel: Any = figure.subplots()
        panel.set_yticks(range(len(names)), names)
        panel.tick_params(axis="y", length=0)
        yield panel
        panel.set_ylim(len(names) - 0.4, -0.8)
        panel.margins(x=0.1)
        _plain(panel, "x")


def _label(panel: Any, text: str, x: float, row: float) -> None:
    panel.annotate(text, (x, row), xytext=(5, 0), textcoords="offset points", va="center", fontsize=8)


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


def draw_run(run: RunData, path: Path) -> None:
    """What each task used over time (Figure 7), with contexts, or without a policy the stretches in which it moves."""
    used = {task: measures.cores_used(run, task) for task in run.inputs}
    until = measures.total_time(run)
    bands = measures.contexts(run) if run.plans else _moving(run)
    draw_shares(used, bands, path, until=until, unit="cores used", title=f"{run.title}: CPU used over time")


def draw_decisions(run: RunData, path: Path) -> None:
    """Weights and shares over time, with the contexts (Figure 5)."""
    steps = [(max(begin - run.started, 0.0), plan["tasks"]) for begin, end, plan in measures.spans(run) if end > begin]
    shares = {task: [(at, tasks[task]["share"]) for at, tasks in steps] for task in run.inputs}
    weights = {task: [(at, _part(tasks, task)) for at, tasks in steps] for task in run.inputs}
    title = f"{run.title}: weights and shares"
    draw_shares(shares, measures.contexts(run), path, until=measures.total_time(run), weights=weights, title=title)


def _part(tasks: Mapping[str, Mapping[str, float]], task: str) -> float:
    total = sum(one["weight"] for one in tasks.values())
    return tasks[task]["weight"] / total if total else 0.0


def _moving(run: RunData) -> Sequence[tuple[str, float, float]]:
    return [
        ("moving (truth)", stretch.start / run.pace, stretch.end / run.pace)
        for stretch in run.stretches
        if stretch.moving
    ]
