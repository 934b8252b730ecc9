"""The result as a picture: a column for each sweep; reaction, CPU and memory one below the other."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from contextpolicy.explain.palette import TASK_COLORS
from contextpolicy.simulation.drawing import INK, STYLE

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    Rows = Sequence[Mapping[str, Any]]

SWEPT = {
    "policies": "policies, 3 tasks each",
    "containers": "containers of one policy",
    "samples": "samples a second that change nothing",
}
WIDTH, HEIGHT = 3.6, 7.6
"""Inches, of a column."""
FIRST, LAST, COST, MEMORY, FLOOR, NODE = (
    TASK_COLORS[1],
    TASK_COLORS[0],
    TASK_COLORS[2],
    TASK_COLORS[3],
    "#777777",
    INK,
)
DASHED = (0, (4, 3))


def draw(result: Mapping[str, Any], path: Path) -> None:
    """Write an SVG of what was measured, without a date: the same figures give the same file."""
    sweeps = {name: result[name] for name in SWEPT if result.get(name)}
    if not sweeps:
        return
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH * len(sweeps), HEIGHT), layout="constrained")
        panels: Any = figure.subplots(3, len(sweeps), sharex="col", squeeze=False)
        for column, (name, rows) in enumerate(sweeps.items()):
            _reaction(panels[0][column], rows, result["node"] if name == "containers" else [])
            _cost(panels[1][column], rows)
            _memory(panels[2][column], rows)
            _finish(panels[:, column], [row["size"] for row in rows], SWEPT[name])
        figure.savefig(path, metadata={"Date": None})


def _reaction(panel: Any, rows: Rows, node: Rows) -> None:
    """Medians, and up to nine in ten as a band."""
    _line(panel, rows, "all_patches_accepted_ms", "last PATCH accepted", color=LAST)
    _line(panel, rows, "first_patch_accepted_ms", "first PATCH accepted", color=FIRST)
    for stage, color in (("all_patches_accepted", LAST), ("first_patch_accepted", FIRST)):
        lower, upper = ([row[f"{stage}{end}"] for row in rows] for end in ("_ms", "_p90_ms"))
        panel.fill_between([row["size"] for row in rows], lower, upper, color=color, alpha=0.15, linewidth=0)
    _line(panel, rows, "storm_all_accepted_ms", "all policies at once", color=COST)
    _line(panel, rows, "bare_patches_accepted_ms", "as many bare PATCHes", color=FLOOR, linestyle=DASHED)
    if node:
        sizes, times = [row["limits"] for row in node], [row["all_ms"] for row in node]
        panel.plot(sizes, times, "D", color=NODE, markersize=5, label="in force, on a real node")
    _logarithmic(panel)
    panel.set_ylabel("sample to PATCH (ms)")


def _cost(panel: Any, rows: Rows) -> None:
    _line(panel, rows, "cpu_ms_per_plan", "operator", color=COST)
    _line(panel, rows, "cpu_ms_per_s", "operator", color=COST)
    _line(panel, rows, "floor_cpu_ms_per_s", "a hand-over and the engine", color=FLOOR, linestyle=DASHED)
    _logarithmic(panel)
    panel.set_ylabel("CPU (ms a second)" if "cpu_ms_per_s" in rows[0] else "CPU (ms a plan)")


def _memory(panel: Any, rows: Rows) -> None:
    _line(panel, rows, "resident_mib", "operator", color=MEMORY)
    panel.set_ylim(0, 1.25 * max(row["resident_mib"] for row in rows))
    panel.set_ylabel("memory (MiB)")


def _logarithmic(panel: Any) -> None:
    """Few plain numbers, however many decades."""
    panel.set_yscale("log")
    panel.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    panel.yaxis.set_major_formatter("{x:g}")
    panel.yaxis.set_minor_locator(NullLocator())


def _line(panel: Any, rows: Rows, key: str, label: str, **style: Any) -> None:
    """One figure of the rows, if they have it."""
    points = [(row["size"], row[key]) for row in rows if key in row]
    if points:
        panel.plot(*zip(*points, strict=True), marker="o", markersize=3.5, linewidth=1.6, label=label, **style)


def _finish(panels: Sequence[Any], sizes: Sequence[int], swept: str) -> None:
    for panel in panels:
        panel.set_xscale("log")
        panel.spines[["top", "right"]].set_visible(False)
        panel.grid(axis="y", color=INK, alpha=0.12, linewidth=0.6)
        panel.set_axisbelow(True)
        panel.legend(frameon=False, fontsize=8)
    panels[-1].set_xticks(sizes, [str(size) for size in sizes])
    panels[-1].minorticks_off()
    panels[-1].set_xlabel(swept)
