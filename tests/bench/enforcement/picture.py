"""The critical tasks' hit rates as a picture: a row for each comparison, a column for each load."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib.figure import Figure

from contextpolicy.explain.palette import task_colors
from contextpolicy.simulation.drawing import INK, STYLE
from tests.bench.enforcement.divisions import CONTEXTUAL, STATIC
from tests.bench.enforcement.inputs import Queue
from tests.bench.enforcement.matrix import Cell
from tests.bench.enforcement.stories import IMPORTANCE, SUSPENDING

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tests.bench.enforcement.figures import Figures
    from tests.bench.enforcement.journal import Journal

ROWS = ((IMPORTANCE.name, False, "nothing suspended"), (SUSPENDING.name, True, "the same gating for all"))
WIDTH, HEIGHT = 3.2, 3.0
"""Inches, of a panel."""
BAR = 0.26


def draw(journal: Journal, path: Path) -> None:
    """Write an SVG, without a date: the same figures give the same file."""
    loads = sorted({cell.load for cell, _, _ in journal.runs()})
    measured = {cell.division for cell, _, _ in journal.runs()}
    names = [name for name in (*STATIC, *CONTEXTUAL) if name in measured]
    if not names:
        return
    with mpl.rc_context({**STYLE, "font.size": 8}):
        figure = Figure(figsize=(1.2 + WIDTH * len(loads), HEIGHT * len(ROWS)), layout="constrained")
        panels: Any = figure.subplots(len(ROWS), len(loads), sharex=True, sharey=True, squeeze=False)
        for row, (story, gated, title) in zip(panels, ROWS, strict=True):
            for panel, load in zip(row, loads, strict=True):
                _bars(panel, [journal.figures(Cell(story, load, Queue.NEWEST, gated, one)) for one in names], names)
                panel.set_title(f"load {load:g}, {title}", fontsize=8)
        handles, labels = panels[0][0].get_legend_handles_labels()
        if handles:
            figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
        figure.savefig(path, metadata={"Date": None})


def _bars(panel: Any, found: Sequence[Figures | None], names: Sequence[str]) -> None:
    """A bar for each context's critical task; a line from the worst to the best block."""
    contexts = IMPORTANCE.contexts
    colors = task_colors(context.critical for context in contexts)
    for number, context in enumerate(contexts):
        shown = [(place, figures) for place, figures in enumerate(found) if figures]
        places = [place + (number - 1) * BAR for place, _ in shown]
        rates = [100 * figures.hit(context.critical, [context.name]) for _, figures in shown]
        blocks = [[100 * rate for rate in figures.hits(context.critical, [context.name])] for _, figures in shown]
        label, color = f"{context.name}: {context.critical}", colors[context.critical]
        panel.barh(places, rates, height=BAR, label=label, color=color)
        panel.hlines(places, [min(one) for one in blocks], [max(one) for one in blocks], color=INK, linewidth=0.7)
    panel.set_yticks(range(len(names)), names)
    panel.set_ylim(len(names) - 0.5, -0.5)
    panel.set_xlim(0, 104)
    panel.set_xlabel("inputs hit (%)")
    panel.spines[["top", "right"]].set_visible(False)
