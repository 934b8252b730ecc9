"""The result as a picture: a column for each sweep; reaction, CPU and memory one below the other.

The panels of a row have the same scale, and lines have their names beside their ends.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from contextpolicy.simulation.drawing import INK, STYLE, name_ends

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    Rows = Sequence[Mapping[str, Any]]

SWEPT = {
    "policies": "policies, 3 tasks each",
    "containers": "containers of one policy",
    "samples": "samples a second that change nothing",
}
WIDTH, HEIGHT = 4.0, 2.2
"""Inches, of a panel."""
ALL, FIRST, STORM = "#2b8a9e", "#d08a3a", "#6f9f4a"
"""Of the operator's lines; what they are compared with has the colour of the axes."""


def draw(result: Mapping[str, Any], path: Path) -> None:
    """Write an SVG of what was measured, without a date: the same figures give the same file."""
    sweeps = {name: result[name] for name in SWEPT if result.get(name)}
    if not sweeps:
        return
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH * len(sweeps), 3 * HEIGHT), layout="constrained")
        panels: Any = figure.subplots(3, len(sweeps), sharex="col", sharey="row", squeeze=False)
        named: list[tuple[Any, dict[str, tuple[float, str]]]] = []
        for column, (name, rows) in enumerate(sweeps.items()):
            node = result["node"] if name == "containers" else []
            drawn = (_reaction(panels[0][column], rows, node), _cost(panels[1][column], rows))
            named += zip(panels[:, column], (*drawn, _memory(panels[2][column], rows)), strict=True)
            _finish(panels[:, column], [row["size"] for row in rows], SWEPT[name])
        for panel, ends in named:  # the scales of a row depend on all of its panels
            name_ends(panel, {name: y for name, (y, _) in ends.items()}, {n: c for n, (_, c) in ends.items()}, HEIGHT)
        figure.savefig(path, metadata={"Date": None})


def _reaction(panel: Any, rows: Rows, node: Rows) -> dict[str, tuple[float, str]]:
    """Medians, and up to nine in ten as a band."""
    for stage, color in (("all_patches_accepted", ALL), ("first_patch_accepted", FIRST)):
        lower, upper = ([row[f"{stage}{end}"] for row in rows] for end in ("_ms", "_p90_ms"))
        panel.fill_between([row["size"] for row in rows], lower, upper, color=color, alpha=0.15, linewidth=0)
    ends = {
        **_line(panel, rows, "bare_patches_accepted_ms", "as many bare PATCHes", INK),
        **_line(panel, rows, "all_patches_accepted_ms", "last PATCH accepted", ALL),
        **_line(panel, rows, "first_patch_accepted_ms", "first PATCH accepted", FIRST),
        **_line(panel, rows, "storm_all_accepted_ms", "all policies at once", STORM),
    }
    if node:
        sizes, times = [row["limits"] for row in node], [row["all_ms"] for row in node]
        panel.plot(sizes, times, "D", color=INK, markersize=4.5)
        place = {"xytext": (-6, 0), "textcoords": "offset points", "ha": "right", "fontsize": 8}
        panel.annotate("in force,\non a real node", (sizes[-1], times[-1]), **place)
    _logarithmic(panel)
    panel.set_ylabel("sample to PATCH (ms)")
    return ends


def _cost(panel: Any, rows: Rows) -> dict[str, tuple[float, str]]:
    ends = {
        **_line(panel, rows, "floor_cpu_ms_per_s", "a hand-over and the engine", INK),
        **_line(panel, rows, "cpu_ms_per_plan", "operator", ALL),
        **_line(panel, rows, "cpu_ms_per_s", "operator", ALL),
    }
    _logarithmic(panel)
    panel.set_ylabel("CPU (ms a second)" if "cpu_ms_per_s" in rows[0] else "CPU (ms a plan)")
    return ends


def _memory(panel: Any, rows: Rows) -> dict[str, tuple[float, str]]:
    ends = _line(panel, rows, "resident_mib", "operator", ALL)
    panel.set_ylim(bottom=0)
    panel.set_ylabel("memory (MiB)")
    return ends


def _logarithmic(panel: Any) -> None:
    """Few plain numbers, however many decades."""
    panel.set_yscale("log")
    panel.yaxis.set_major_locator(LogLocator())
    panel.yaxis.set_major_formatter("{x:g}")
    panel.yaxis.set_minor_locator(NullLocator())


def _line(panel: Any, rows: Rows, key: str, label: str, color: str) -> dict[str, tuple[float, str]]:
    """One figure of the rows, if they have it; its name with where it ends."""
    points = [(row["size"], row[key]) for row in rows if key in row]
    if not points:
        return {}
    panel.plot(*zip(*points, strict=True), marker="o", markersize=3, linewidth=1.4, color=color)
    return {label: (points[-1][1], color)}


def _finish(panels: Sequence[Any], sizes: Sequence[int], swept: str) -> None:
    for panel in panels:
        panel.set_xscale("log")
        panel.spines[["top", "right"]].set_visible(False)
        panel.grid(axis="y", color=INK, alpha=0.25, linewidth=0.6)
        panel.set_axisbelow(True)
    panels[-1].set_xticks(sizes, [str(size) for size in sizes])
    panels[-1].minorticks_off()
    panels[-1].set_xlabel(swept)
