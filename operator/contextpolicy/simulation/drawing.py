"""Pictures of shares over time, in the manner of the paper's Figures 5 and 7, from plain data.

A series maps each task to its (time, value) steps: a value holds until the next one.
"""

from __future__ import annotations

from bisect import bisect_right
from itertools import accumulate
from typing import TYPE_CHECKING, Any, TypeAlias

from contextpolicy.errors import DrawingError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    Steps: TypeAlias = Sequence[tuple[float, float]]
    Series: TypeAlias = Mapping[str, Steps]
    Span: TypeAlias = tuple[str, float, float]

TASK_COLORS = ("#2a6f97", "#e07a3f", "#5b8e55", "#8d5b8c", "#c2a83e", "#4f9da6", "#b5495b", "#6c757d")
CONTEXT_COLORS = ("#f6c453", "#9fd3c7", "#d5b6e8", "#f2a6a6", "#b8d8f0", "#d9d9a5")


def draw_shares(  # noqa: PLR0913 - what a picture may show, by keyword
    series: Series,
    contexts: Sequence[Span],
    path: Path | str,
    *,
    until: float,
    weights: Series | None = None,
    measured: Series | None = None,
    title: str = "",
) -> None:
    """Write an SVG or PNG: shares in cores stacked, contexts (name, start, end) as coloured bands.

    `weights` adds a panel of normalised weights above; `measured` lays the limits that were read back over the stack.
    """
    try:
        import matplotlib as mpl  # noqa: PLC0415 - an extra, and slow to load
        from matplotlib.figure import Figure  # noqa: PLC0415
    except ImportError as error:
        raise DrawingError("drawing needs matplotlib: pip install 'contextpolicy[plot]'") from error
    with mpl.rc_context({"svg.hashsalt": "contextpolicy", "font.size": 9, "svg.fonttype": "none"}):
        figure = Figure(figsize=(9, 5.4 if weights else 3.4), layout="constrained")
        panels = list(figure.subplots(2 if weights else 1, 1, sharex=True, squeeze=False)[:, 0])
        _bands(panels, contexts)
        if weights:
            _lines(panels[0], weights, until)
        _stack(panels[-1], series, until)
        if measured:
            _outline(panels[-1], list(series), measured, until)
        _finish(figure, panels, title, until)
        try:
            figure.savefig(path, dpi=150, metadata={"Date": None} if str(path).endswith(".svg") else None)
        except (OSError, ValueError) as error:
            raise DrawingError(f"{path}: {error}") from error


def _bands(panels: Sequence[Any], contexts: Sequence[Span]) -> None:
    names = list(dict.fromkeys(name for name, _, _ in contexts))
    for name, start, end in contexts:
        color = CONTEXT_COLORS[names.index(name) % len(CONTEXT_COLORS)]
        for panel in panels[:-1]:
            panel.axvspan(start, end, color=color, alpha=0.35, linewidth=0)
        for time in (start, end):
            panels[-1].axvline(time, color="#333333", linewidth=0.8, linestyle=(0, (4, 3)))
        lane = 1.02 + 0.1 * names.index(name)
        strip = {"transform": panels[0].get_xaxis_transform(), "clip_on": False}
        panels[0].plot([start, end], [lane + 0.02] * 2, color=color, linewidth=5, solid_capstyle="butt", **strip)
        panels[0].text((start + end) / 2, lane + 0.035, name, ha="center", va="bottom", fontsize=8, **strip)


def _lines(panel: Any, weights: Series, until: float) -> None:
    for index, (task, steps) in enumerate(weights.items()):
        times, values = _closed(steps, until)
        color = TASK_COLORS[index % len(TASK_COLORS)]
        # Lines that lie on each other stay visible: the first is the widest.
        panel.step(times, values, where="post", label=task, color=color, linewidth=max(1.4, 3.4 - 0.8 * index))
    panel.set_ylabel("weight / sum of weights")
    panel.set_ylim(-0.03, 1.05)


def _stack(panel: Any, series: Series, until: float) -> None:
    times = _instants(series, until)
    rows = [[_at(steps, time) for time in times] for steps in series.values()]
    colors = [TASK_COLORS[index % len(TASK_COLORS)] for index in range(len(rows))]
    panel.stackplot(times, rows, labels=list(series), colors=colors, step="post", alpha=0.9, linewidth=0)
    panel.set_ylabel("share (cores)")
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
        panel.legend(loc="center left", bbox_to_anchor=(1.005, 0.5), frameon=False)
        panel.set_xlim(0, until)
    panels[-1].set_xlabel("time (s)")
    if title:
        figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")


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
