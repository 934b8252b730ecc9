"""A forecast as text for people, and as fields for JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from contextpolicy.explain.text_table import text_table, wrapped
from contextpolicy.simulation.forecast import ALL

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.simulation.forecast import Forecast, Stats

HEADER = ("TASK", "CONTEXT", "INPUTS", "DONE", "LATE", "DROPPED", "SUSPENDED", "MISSES", "WORST", "P50", "P99", "QUEUE")
WHOLE = "all"


def as_table(forecast: Forecast, width: int | None = None) -> str:
    """A row for each task and context, then the idle cores; see `text_table` for `width`."""
    lines = text_table(HEADER, list(_rows(forecast)), width, right=range(2, len(HEADER)))
    idle = ", ".join(f"{name or WHOLE} {cores:.2f}" for name, cores in forecast.idle.items())
    return "\n".join([*lines, *wrapped(f"idle cores: {idle or 'unknown'}", width, "", "  ")])


def as_fields(forecast: Forecast) -> dict[str, Any]:
    """Tasks with their deadline and statistics by context (`all` is the whole run), and idle cores by context."""
    return {
        "tasks": {
            task: {
                "deadline": forecast.deadlines[task],
                "contexts": {name or WHOLE: asdict(stats) for name, stats in by_context.items()},
            }
            for task, by_context in forecast.tasks.items()
        },
        "idle": {name or WHOLE: cores for name, cores in forecast.idle.items()},
    }


def _rows(forecast: Forecast) -> Iterator[tuple[str, ...]]:
    for task, by_context in forecast.tasks.items():
        for name, stats in sorted(by_context.items(), key=lambda item: (item[0] != ALL, item[0])):
            yield (task, name or WHOLE, *_cells(stats))


def _cells(stats: Stats) -> tuple[str, ...]:
    counts = (stats.inputs, stats.done, stats.missed, stats.dropped, stats.suspended)
    times = ("-" if time is None else f"{time * 1000:.0f} ms" for time in (stats.p50, stats.p99))
    return (*map(str, counts), f"{stats.misses:.1%}", f"{stats.worst:.1%}", *times, f"{stats.queue:.1f}")
