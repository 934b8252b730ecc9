"""The report's pictures, in the manner of the paper's Figures 5 to 7, as SVG."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib.figure import Figure

from contextpolicy.simulation.drawing import TASK_COLORS, draw_shares
from timelines.experiments import measures

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from timelines.experiments.raw_data import RunData

    Spread = tuple[float, float, float]

WIDTH, BAR = 9.0, 0.42
"""Inches: the picture's width, and what each bar takes of its height."""


def draw_bars(values: Mapping[str, Spread], path: Path, *, title: str, unit: str, mark: float | None = None) -> None:
    """A bar for each configuration: its median, with a whisker from least to greatest; `mark` is a line."""
    with mpl.rc_context({"svg.hashsalt": "contextpolicy", "font.size": 9, "svg.fonttype": "none"}):
        figure = Figure(figsize=(WIDTH, BAR * len(values) + 1.0), layout="constrained")
        panel: Any = figure.subplots()
        names, medians = list(values), [value[0] for value in values.values()]
        around = [[max(m - low, 0), max(high - m, 0)] for m, low, high in values.values()]
        colors = [TASK_COLORS[index % len(TASK_COLORS)] for index in range(len(names))]
        panel.barh(names, medians, xerr=list(zip(*around, strict=True)), color=colors, height=0.62, ecolor="#333333")
        for row, (m, _, high) in enumerate(values.values()):
            panel.annotate(f"{m:.3g}", (high, row), xytext=(5, 0), textcoords="offset points", va="center")
        if mark is not None:
            panel.axvline(mark, color="#333333", linewidth=0.8, linestyle=(0, (4, 3)))
        panel.invert_yaxis()
        panel.margins(x=0.08)
        panel.spines[["top", "right"]].set_visible(False)
        panel.grid(axis="x", color="black", alpha=0.12, linewidth=0.6)
        panel.set_axisbelow(True)
        panel.set_xlabel(unit)
        figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
        figure.savefig(path, metadata={"Date": None})


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
    return [("moving (truth)", stretch.start, stretch.end) for stretch in run.stretches if stretch.moving]
