"""Pictures of shares over time, in the manner of the paper's Figures 5 and 7, from plain data.

A series maps each task to its (time, value) steps: a value holds until the next one.
"""

from __future__ import annotations

from bisect import bisect_right
from itertools import accumulate, pairwise
from math import nextafter
from typing import TYPE_CHECKING, Any, TypeAlias

from contextpolicy.errors import DrawingError
from contextpolicy.explain.palette import context_colors, task_colors

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    Steps: TypeAlias = Sequence[tuple[float, float]]
    Series: TypeAlias = Mapping[str, Steps]
    Span: TypeAlias = tuple[str, float, float]

WIDTH, SHORT, TALL, MARGIN = 9.0, 2.0, 2.4, 1.0
"""Inches: the picture's width, the heights of the panels of weights and of shares, and the margin."""
LANE, LINE = 0.24, 0.2
"""Inches: the heights of a context's lane and of a task's name."""

INK = "#767c85"
"""Text and axes: legible on a white page and on a dark one, because the pictures are transparent."""
STYLE: dict[Any, Any] = {
    # A fixed salt, and no date in the file: the same plans give the same SVG, byte for byte.
    "svg.hashsalt": "contextpolicy",
    "svg.fonttype": "none",
    "font.size": 9,
    **dict.fromkeys(("figure.facecolor", "axes.facecolor"), "none"),
    **dict.fromkeys(("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color"), INK),
}


def draw_shares(  # noqa: PLR0913 - what a picture may show, by keyword
    series: Series,
    contexts: Sequence[Span],
    path: Path | str,
    *,
    until: float,
    weights: Series | None = None,
    title: str = "",
    label: str = "share (cores)",
) -> None:
    """Write an SVG or PNG: shares as stacked areas, contexts (name, start, end) as lanes above.

    `weights` adds a panel of normalised weights above.
    Raises DrawingError without matplotlib, and for a file that can't be written.
    """
    try:
        import matplotlib as mpl  # noqa: PLC0415 - an extra, and slow to load
        from matplotlib.figure import Figure  # noqa: PLC0415
    except ImportError as error:
        raise DrawingError("drawing needs matplotlib: pip install '.[plot]' in a checkout") from error
    with mpl.rc_context(STYLE):
        lanes = len({name for name, _, _ in contexts})
        least = LINE * len(series)
        heights = [LANE * lanes] * bool(lanes) + [max(SHORT, least)] * bool(weights) + [max(TALL, least)]
        figure = Figure(figsize=(WIDTH, sum(heights) + MARGIN), layout="constrained")
        panels = list(figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0])
        if weights:
            _lines(panels[-2], weights, until)
        _stack(panels[-1], series, until, label)
        finish(figure, panels, title, until)
        if lanes:
            draw_lanes(panels[0], contexts)
        try:
            figure.savefig(path, dpi=150, metadata={"Date": None} if str(path).endswith(".svg") else None)
        except (OSError, ValueError) as error:
            raise DrawingError(f"{path}: {error}") from error


def draw_lanes(panel: Any, contexts: Sequence[Span]) -> None:
    """When each context held, one lane for each, the first on top."""
    names = list(dict.fromkeys(name for name, _, _ in contexts))
    colors = context_colors(names)
    for name, start, end in contexts:
        panel.broken_barh([(start, end - start)], (names.index(name) - 0.35, 0.7), facecolor=colors[name])
    panel.set_yticks(range(len(names)), names)
    panel.tick_params(axis="both", length=0)
    panel.set_ylim(max(len(names), 1) - 0.5, -0.5)
    panel.spines[:].set_visible(False)
    panel.grid(visible=False)


def _lines(panel: Any, weights: Series, until: float) -> None:
    colors = task_colors(weights)
    for index, (task, steps) in enumerate(weights.items()):
        times, values = _closed(steps, until)
        # Lines that lie on each other stay visible: the first is the widest.
        panel.step(times, values, where="post", color=colors[task], linewidth=max(1.2, 2.8 - 0.4 * index))
    panel.set_ylabel("weight / sum of weights")
    panel.set_ylim(-0.03, 1.05)
    ends = {task: _last(steps, until) for task, steps in weights.items()}
    name_ends(panel, ends, colors, max(SHORT, LINE * len(weights)))


def _stack(panel: Any, series: Series, until: float, label: str) -> None:
    times = _instants(series, until)
    rows = [[_at(steps, time) for time in times] for steps in series.values()]
    own = task_colors(series)
    if not rows:
        panel.text(until / 2, 0.5, "no plan", ha="center", va="center")
    else:
        panel.stackplot(times, rows, colors=[own[task] for task in series], step="post", linewidth=0)
    panel.set_ylim(bottom=0)
    panel.locator_params(axis="y", nbins=5, steps=[1, 2, 5, 10])
    panel.set_ylabel(label)
    ends = accumulate((_last(steps, until) for steps in series.values()), initial=0.0)
    middles = [(low + high) / 2 for low, high in pairwise(ends)]
    name_ends(panel, dict(zip(series, middles, strict=True)), own, max(TALL, LINE * len(series)))


def name_ends(panel: Any, places: Mapping[str, float], colors: Mapping[str, str], height: float) -> None:
    """Names beside the ends of lines or areas in a panel of so many inches, none over another."""
    from matplotlib.transforms import offset_copy  # noqa: PLC0415 - an extra

    to_panel = panel.transData - panel.transAxes
    right = panel.get_xlim()[1]
    ends = {name: float(to_panel.transform((right, place))[1]) for name, place in places.items()}
    upwards = sorted(ends, key=lambda name: ends[name])
    for name, y in zip(upwards, _spread([ends[name] for name in upwards], LINE / height), strict=True):
        mark, text = (offset_copy(panel.transAxes, panel.figure, points, units="points") for points in (7, 13))
        panel.plot([1], [y], marker="s", markersize=5, color=colors[name], transform=mark, clip_on=False)
        panel.text(1, y, name, fontsize=8, va="center", transform=text)


def _spread(places: Sequence[float], gap: float) -> list[float]:
    """Ascending places in the same order, at least `gap` apart and half of it from 0 and from 1."""
    up: list[float] = []
    for place in places:
        up.append(max(place, up[-1] + gap if up else gap / 2))
    down: list[float] = []
    for place in reversed(up):
        down.append(min(place, down[-1] - gap if down else 1 - gap / 2))
    return down[::-1]


def finish(figure: Any, panels: Sequence[Any], title: str, until: float) -> None:
    """Nothing but what the eye needs: faint lines at the ticks, seconds, a title."""
    for panel in panels:
        panel.spines[["top", "right"]].set_visible(False)
        panel.set_axisbelow(True)
        panel.grid(axis="y", color=INK, alpha=0.25, linewidth=0.6)
        panel.set_xlim(0, until or 1)
    panels[-1].set_xlabel("time (s)")
    if title:
        text = "".join(letter if letter.isprintable() else " " for letter in title)
        figure.suptitle(text, x=0.01, ha="left", fontsize=11, fontweight="bold")


def _instants(series: Series, until: float) -> list[float]:
    return sorted({time for steps in series.values() for time, _ in steps if time <= until} | {0.0, until})


def _at(steps: Steps, time: float) -> float:
    """The value in force at a time; 0 before the first."""
    index = bisect_right(steps, time, key=lambda step: step[0])
    return steps[index - 1][1] if index else 0.0


def _last(steps: Steps, until: float) -> float:
    """The value that is drawn last: one from `until` on has no width."""
    return _at(steps, nextafter(until, 0.0))


def _closed(steps: Steps, until: float) -> tuple[list[float], list[float]]:
    """Times and values with the last value drawn to the end."""
    inside = [(time, value) for time, value in steps if time <= until]
    ends = [*inside, (until, inside[-1][1])] if inside else []
    return [time for time, _ in ends], [value for _, value in ends]
