"""The report's pictures, in the manner of the paper's Figures 5 to 7, as SVG."""

from __future__ import annotations

from contextlib import contextmanager
from statistics import median
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib.figure import Figure

from contextpolicy.simulation.drawing import TASK_COLORS, draw_shares
from timelines.experiments import measures

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from timelines.experiments.intervals import Interval
    from timelines.experiments.raw_data import RunData

WIDTH, BAR = 9.0, 0.42
"""Inches: the picture's width, and what each bar takes of its height."""
_BARS = {"height": 0.62, "ecolor": "#333333"}


def draw_bars(values: Mapping[str, Sequence[float]], path: Path, *, title: str) -> None:
    """A bar for each configuration: the median of its percentages, with a whisker from least to greatest."""
    with _figure(BAR * len(values) + 1.0, title, path) as figure:
        panel: Any = figure.subplots()
        medians = {name: median(own) for name, own in values.items()}
        around = [[medians[name] - min(own), max(own) - medians[name]] for name, own in values.items()]
        panel.barh(
            list(values),
            list(medians.values()),
            xerr=list(zip(*around, strict=True)),
            color=_colors(len(values)),
            **_BARS,
        )
        for row, own in enumerate(values.values()):
            panel.annotate(
                f"{median(own):.3g} %", (max(own), row), xytext=(5, 0), textcoords="offset points", va="center"
            )
        panel.invert_yaxis()
        panel.margins(x=0.08)
        _plain(panel, "x")
        panel.set_xlabel("% of the inputs that were due")


def draw_speedups(values: Mapping[str, Mapping[str, Interval]], path: Path) -> None:
    """Figure 6: of each series a group of bars, a configuration each, with the interval; 1 is Linux default."""
    names = list(dict.fromkeys(name for own in values.values() for name in own))
    colors = dict(zip(names, _colors(len(names)), strict=True))
    rows = [(series, name, found) for series, own in values.items() for name, found in own.items()]
    heights = [index + 0.8 * list(values).index(series) for index, (series, _, _) in enumerate(rows)]
    with _figure(0.27 * len(rows) + 1.2, "Speedup in total time over Linux default", path) as figure:
        panel: Any = figure.subplots()
        for height, (series, name, found) in zip(heights, rows, strict=True):
            low, high = (found.middle if end is None else end for end in (found.low, found.high))
            around = [[found.middle - low], [high - found.middle]]
            panel.barh(height, found.middle, xerr=around, color=colors[name], height=0.8, ecolor="#333333")
            text = f"{name}  {found.middle:.2f} x"
            panel.annotate(text, (high, height), xytext=(5, 0), textcoords="offset points", va="center", fontsize=8)
            if name == next(iter(values[series])):
                panel.annotate(
                    series, (0, height - 0.95), va="center", fontsize=9, fontweight="bold", annotation_clip=False
                )
        panel.axvline(1, color="#333333", linewidth=0.8, linestyle=(0, (4, 3)))
        panel.set_yticks([])
        panel.set_ylim(max(heights) + 0.8, -1.5)
        panel.margins(x=0.25)
        _plain(panel, "x")
        panel.set_xlabel("x")


def draw_responses(times: Mapping[str, Sequence[float]], path: Path, *, title: str, deadline: float | None) -> None:
    """How many of the answers came within which time, and the deadline as a line; `times` ascend, in seconds."""
    with _figure(3.4, title, path) as figure:
        panel: Any = figure.subplots()
        for color, (name, own) in zip(_colors(len(times)), times.items(), strict=True):
            parts = [100 * (index + 1) / len(own) for index in range(len(own))]
            panel.step([1000 * time for time in own], parts, where="post", label=name, color=color, linewidth=1.6)
        if deadline:
            panel.axvline(1000 * deadline, color="#333333", linewidth=0.8, linestyle=(0, (4, 3)), label="deadline")
        panel.set_xscale("log")
        panel.set_xlabel("response time (ms)")
        panel.set_ylabel("% of the answers")
        panel.set_ylim(0, 102)
        _plain(panel, "both")
        panel.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.005, 0.5))


@contextmanager
def _figure(height: float, title: str, path: Path) -> Iterator[Figure]:
    """An empty picture that is saved at the end, without a date: the same runs give the same file."""
    with mpl.rc_context({"svg.hashsalt": "contextpolicy", "font.size": 9, "svg.fonttype": "none"}):
        figure = Figure(figsize=(WIDTH, height), layout="constrained")
        yield figure
        figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
        figure.savefig(path, metadata={"Date": None})


def _plain(panel: Any, grid: str) -> None:
    panel.spines[["top", "right"]].set_visible(False)
    panel.grid(axis=grid, color="black", alpha=0.12, linewidth=0.6)
    panel.set_axisbelow(True)


def _colors(count: int) -> list[str]:
    return [TASK_COLORS[index % len(TASK_COLORS)] for index in range(count)]


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
