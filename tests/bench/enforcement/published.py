"""The tables of docs/decisions/enforcement.md, from the committed measurements.

    python -m tests.bench.enforcement.published [FILE]

prints them; a test compares the page with them.
"""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from tests.bench.enforcement.divisions import (
    BUDGETS,
    DEFAULT,
    LIMITS,
    PINNED,
    PRIORITY,
    ROUND_ROBIN,
    SUSPENSION,
    TUNED,
    WEIGHTS,
)
from tests.bench.enforcement.inputs import Queue
from tests.bench.enforcement.journal import Journal
from tests.bench.enforcement.matrix import HEAVY, LIGHT, Cell
from tests.bench.enforcement.opponents import best_static
from tests.bench.enforcement.stories import IMPORTANCE, SUSPENDING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from tests.bench.enforcement.figures import Figures
    from tests.bench.enforcement.stories import Story

MEASURED = Path(__file__).parents[3] / "docs" / "measurements" / "enforcement.jsonl"
NAMES = {
    DEFAULT: "Linux' default",
    PRIORITY: "static weights by priority",
    TUNED: "static weights tuned for this story",
    PINNED: "pinned to processors",
    ROUND_ROBIN: "slam under SCHED_RR",
    LIMITS: "context limits",
    BUDGETS: "context realtime budgets",
    WEIGHTS: "**context weights**",
    SUSPENSION: "context suspension alone",
}


def load(file: Path = MEASURED) -> Journal:
    """What was measured."""
    options = json.loads(file.read_text(encoding="utf-8").split("\n", 1)[0])
    return Journal(file, options, resume=True)


def tables(journal: Journal) -> dict[str, str]:
    """Each table by what it shows."""
    return {
        "light load, nothing suspended": _light(journal, IMPORTANCE, (DEFAULT, LIMITS, BUDGETS, WEIGHTS), gated=False),
        "light load, gated": _light(journal, SUSPENDING, (DEFAULT, SUSPENSION, WEIGHTS), gated=True),
        **{f"load {load:g}, nothing suspended": _heavy(journal, IMPORTANCE, load, gated=False) for load in HEAVY},
        **{f"load {load:g}, gated": _heavy(journal, SUSPENDING, load, gated=True) for load in HEAVY},
    }


def percent(rate: float) -> str:
    """A rate in the page's words."""
    return "-" if math.isnan(rate) else f"{rate:.1%}".replace(".0%", "%").replace("%", " %")


def _light(journal: Journal, story: Story, divisions: Iterable[str], *, gated: bool) -> str:
    found = _found(journal, story, LIGHT, divisions, gated=gated)
    tasks = next(iter(found.values())).tasks
    head = [f"load {LIGHT:g}: hits, p99", "blocks", *tasks, "work"]
    return _markdown(
        head,
        [
            [NAMES[name], str(len(one.runs)), *(_hit_and_p99(one, task) for task in tasks), f"{one.work:.2f} s"]
            for name, one in found.items()
        ],
    )


def _heavy(journal: Journal, story: Story, load: float, *, gated: bool) -> str:
    found = _found(journal, story, load, NAMES, gated=gated)
    best = best_static(journal.figures, story.name, load, gated=gated)
    first = next(iter(found.values()))
    critical = [f"{context.name}: {context.critical}" for context in first.story.contexts]
    head = [f"load {load:g}", "blocks", *critical, *first.tasks, "work"]
    return _markdown(
        head, [_row(_name(name, best and best.division), one) for name, one in found.items() if name != SUSPENSION]
    )


def _name(division: str, best: str | None) -> str:
    return f"{NAMES[division]} (the best static one)" if division == best else NAMES[division]


def _row(name: str, figures: Figures) -> list[str]:
    own = map(percent, figures.critical().values())
    whole = (percent(figures.hit(task)) for task in figures.tasks)
    return [name, str(len(figures.runs)), *own, *whole, f"{figures.work:.2f} s"]


def _hit_and_p99(figures: Figures, task: str) -> str:
    slow = figures.quantile(task, 0.99)
    return f"{percent(figures.hit(task))}, {'never' if math.isinf(slow) else f'{slow * 1000:.1f} ms'}"


def _found(journal: Journal, story: Story, load: float, divisions: Iterable[str], *, gated: bool) -> dict[str, Figures]:
    cells = {name: Cell(story.name, load, Queue.NEWEST, gated=gated, division=name) for name in divisions}
    measured = {name: journal.figures(cell) for name, cell in cells.items()}
    return {name: figures for name, figures in measured.items() if figures}


def _markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows))


if __name__ == "__main__":
    for what, table in tables(load(*map(Path, sys.argv[1:2]))).items():
        print(f"{what}\n\n{table}\n")
