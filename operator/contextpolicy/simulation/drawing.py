"""Pictures of shares over time, in the manner of the paper's Figures 5 and 7, from plain data.

A series maps each task to its (time, value) steps: a value holds until the next one.
"""

from __future__ import annotations

from bisect import bisect_right
from itertools import accumulate
from typing import TYPE_CHECKING, Any, TypeAlias

from contextpolicy.errors import DrawingError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    Steps: TypeAlias = Sequence[tuple[float, float]]
    Series: TypeAlias = Mapping[str, Steps]
    Span: TypeAlias = tuple[str, float, float]

TASK_COLORS = ("#2a6f97", "#e07a3f", "#5b8e55", "#8d5b8c", "#c2a83e", "#4f9da6", "#b5495b", "#6c757d")
CONTEXT_COLORS = ("#f6c453", "#9fd3c7", "#d5b6e8", "#f2a6a6", "#b8d8f0", "#d9d9a5")

WIDTH, SHORT, TALL, MARGIN = 9.0, 2.0, 2.4, 1.0
"""Inches: the picture's width, the heights of the panels of weights and of shares, and the margin."""
LANE, LINE = 0.24, 0.2
"""Inches: the heights of a context's lane and of a line of the legend."""


def draw_shares(  # noqa: PLR0913 - what a picture may show, by keyword
    series: Series,
    contexts: Sequence[Span],
    path: Path | str,
    *,
    until: float,
    weights: Series | None = None,
    measured: Series | None = None,
    title: str = "",
    unit: str = "cores",
) -> None:
    """Write an SVG or PNG: shares stacked, contexts (name, start, end) as coloured bands.

    `weights` adds a panel of normalised weights above; `measured` draws the limits that were read back over the stack.
    Raises DrawingError without matplotlib, and for a file that can't be written.
    """
    try:
        import matplotlib as mpl  # noqa: PLC0415 - an extra, and slow to load
        from matplotlib.figure import Figure  # noqa: PLC0415
    except ImportError as error:
        raise DrawingError("drawing needs matplotlib: pip install 'contextpolicy[plot]'") from error
    # A fixed salt, and no date below: the same plans give the same SVG, byte for byte.
    with mpl.rc_context({"svg.hashsalt": "contextpolicy", "font.size": 9, "svg.fonttype": "none"}):
        lanes = list(dict.fromkeys(name for name, _, _ in contexts))
        heights = [LANE * len(lanes)] * bool(lanes) + [SHORT] * bool(weights) + [max(TALL, LINE * len(series))]
        figure = Figure(figsize=(WIDTH, sum(heights) + MARGIN), layout="constrained")
        panels = list(figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0])
        if lanes:
            _lanes(panels[0], lanes, contexts)
        if weights:
            _bands(panels[-2], lanes, contexts)
            _lines(panels[-2], weights, until)
        _stack(panels[-1], series, until, [time for _, *span in contexts for time in span])
        panels[-1].set_ylabel(f"share ({unit})")
        if measured:
            _outline(panels[-1], list(series), measured, until)
        _finish(figure, panels, title, until)
        try:
            figure.savefig(path, dpi=150, metadata={"Date": None} if str(path).endswith(".svg") else None)
        except (OSError, ValueError) as error:
            raise DrawingError(f"{path}: {error}") from error


def _lanes(panel: Any, names: Sequence[str], contexts: Sequence[Span]) -> None:
    """When each context held, one lane for each, the first on top."""
    for name, start, end in contexts:
        lane, color = names.index(name), CONTEXT_COLORS[names.index(name) % len(CONTEXT_COLORS)]
        panel.broken_barh([(start, end - start)], (lane - 0.35, 0.7), facecolor=color)
    panel.set_yticks(range(len(names)), names)
    panel.tick_params(axis="both", length=0)
    panel.set_ylim(len(names) - 0.5, -0.5)


def _bands(panel: Any, names: Sequence[str], contexts: Sequence[Span]) -> None:
    for name, start, end in contexts:
        color = CONTEXT_COLORS[names.index(name) % len(CONTEXT_COLORS)]
        panel.axvspan(start, end, color=color, alpha=0.35 / max(1, len(names) / 3), linewidth=0)


def _lines(panel: Any, weights: Series, until: float) -> None:
    for index, (task, steps) in enumerate(weights.items()):
        times, values = _closed(steps, until)
        color = _color(index)
        # Lines that lie on each other stay visible: the first is the widest.
        panel.step(times, values, where="post", label=task, color=color, linewidth=max(1.4, 3.4 - 0.8 * index))
    panel.set_ylabel("weight / sum of weights")
    panel.set_ylim(-0.03, 1.05)


def _stack(panel: Any, series: Series, until: float, turns: Iterable[float]) -> None:
    """`turns` are the moments at which contexts begin and end."""
    times = _instants(series, until)
    rows = [[_at(steps, time) for time in times] for steps in series.values()]
    if not rows:
        panel.text(until / 2, 0.5, "no plan", ha="center", va="center")
    else:
        colors = [_color(index) for index in range(len(rows))]
        panel.stackplot(times, rows, labels=list(series), colors=colors, step="post", alpha=0.9, linewidth=0)
    for time in set(turns):
        panel.axvline(time, color="#333333", linewidth=0.6, alpha=0.7, linestyle=(0, (4, 3)))
    panel.set_ylim(bottom=0)


def _outline(panel: Any, tasks: Sequence[str], measured: Series, until: float) -> None:
    """The measured limits, summed up in the order of the stack, so that each line lies on its area's edge."""
    times = _instants(measured, until)
    columns = [list(accumulate(_at(measured[task], time) for task in tasks if task in measured)) for time in times]
    for index, edge in enumerate(zip(*columns, strict=True)):
        label = "measured" if index == 0 else None
        panel.step(times, edge, where="post", color="black", linewidth=1.1, linestyle=(0, (3, 1.5)), label=label)


def _finish(figure: Any, panels: Sequence[Any], title: str, until: float) -> None:
    for panel in panels:
        panel.spines[["top", "right"]].set_visible(False)
        panel.set_axisbelow(True)
        panel.grid(axis="y", color="black", alpha=0.12, linewidth=0.6)
        panel.set_xlim(0, until or 1)
    # The tasks' colours are the same in all panels, and the stack's order is the one to read them in.
    handles, labels = panels[-1].get_legend_handles_labels()
    if handles:
        upwards = {"reverse": True, "loc": "center left", "bbox_to_anchor": (1.005, 0.5)}
        panels[-1].legend(handles, labels, frameon=False, fontsize=8, labelspacing=0.3, **upwards)
    panels[-1].set_xlabel("time (s)")
    if title:
        text = "".join(letter if letter.isprintable() else " " for letter in title)
        figure.suptitle(text, x=0.01, ha="left", fontsize=11, fontweight="bold")


def _color(index: int) -> tuple[float, float, float]:
    """The first eight tasks' colours; then the same ones lighter, and darker."""
    turn, place = divmod(index, len(TASK_COLORS))
    towards, part = ((0.0, 0.0), (1.0, 0.5), (0.0, 0.45))[turn % 3]
    digits = TASK_COLORS[place][1:]
    red, green, blue = (int(digits[at : at + 2], 16) / 255 for at in (0, 2, 4))
    return red + (towards - red) * part, green + (towards - green) * part, blue + (towards - blue) * part


def _instants(series: Series, until: float) -> list[float]:
    return sorted({time for steps in series.values() for time, _ in steps if time <= until} | {0.0, until})


def _at(steps: Steps, time: float) -> float:
    """The value in force at a time; 0 before the first."""
    index = bisect_right(steps, time, key=lambda step: step[0])
    return steps[index - 1][1] if index else 0.0


def _closed(steps: Steps, until: float) -> tuple[list[float], list[float]]:
    """Times and values with the last value drawn to the end."""
    inside = [(time, value) for time, value in steps if time <= until]
    ends = [*inside, (until, inside[-1][1])] if inside else []
    return [time for time, _ in ends], [value for _, value in ends]
