"""The demo as a picture: for each task its planned share as an area, and the CPU it used as a line."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib.figure import Figure

from contextpolicy.explain.palette import task_colors
from contextpolicy.simulation.drawing import LANE, MARGIN, STYLE, WIDTH, draw_lanes, finish
from timelines.demo import verdict

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from timelines.demo.recorder import Recording

STRIP = 0.55
"""Inches: a task's height."""


def draw(recording: Recording, tasks: Sequence[str], started: float, duration: float, path: Path) -> None:
    """Write an SVG of a timeline of that many seconds that started at a Unix time."""
    contexts = [(name, start, min(end, duration)) for name, start, end in verdict.spans(recording, started)]
    heights = [LANE * max(1, len({name for name, _, _ in contexts})), *[STRIP] * len(tasks)]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, sum(heights) + MARGIN), layout="constrained")
        panels: Any = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
        for panel, task in zip(panels[1:], tasks, strict=True):
            _strip(panel, task, _planned(recording, task, started, duration), _used(recording, task, started))
        top = max(panel.get_ylim()[1] for panel in panels[1:])
        for panel in panels[1:]:
            panel.set_ylim(0, top)
        title = "Each task's planned share of contested CPU (area) and the CPU it used (line), in cores"
        finish(figure, panels, title, duration)
        draw_lanes(panels[0], contexts)
        for panel in panels[1:-1]:
            panel.tick_params(axis="x", length=0)
        figure.savefig(path, metadata={"Date": None})


def _strip(panel: Any, task: str, planned: Sequence[tuple[float, float]], used: Sequence[tuple[float, float]]) -> None:
    color = task_colors([task])[task]
    panel.fill_between(*zip(*planned, strict=True), step="post", color=color, alpha=0.3, linewidth=0)
    panel.step(*zip(*used, strict=True), where="post", color=color, linewidth=1.2)
    panel.set_ylabel(task, rotation=0, ha="right", va="center")
    panel.locator_params(axis="y", nbins=3, steps=[1, 2, 5, 10])


def _planned(recording: Recording, task: str, started: float, duration: float) -> list[tuple[float, float]]:
    steps = [(max(0.0, plan["trigger"] - started), plan["tasks"][task]["share"]) for plan in recording.plans]
    return [*steps, (duration, steps[-1][1] if steps else 0.0)]


def _used(recording: Recording, task: str, started: float) -> list[tuple[float, float]]:
    """Cores over each interval, by its beginning."""
    own = pairwise(recording.usage.get(task, ()))
    return [(then - started, (high - low) / (now - then)) for (then, low), (now, high) in own] or [(0.0, 0.0)]
