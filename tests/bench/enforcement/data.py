"""The figures as plain data. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from tests.bench.enforcement.goals import statics
from tests.bench.enforcement.matrix import HEAVY, Cell
from tests.bench.enforcement.opponents import best_static, losses_of_others
from tests.bench.enforcement.stories import IMPORTANCE, SUSPENDING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tests.bench.enforcement.goals import Verdict
    from tests.bench.enforcement.journal import Journal


def values(journal: Journal, about: Mapping[str, Any], judged: Sequence[Verdict]) -> dict[str, Any]:
    """The same as plain data."""
    return {
        "about": dict(about),
        "goals": [
            {
                "goal": one.goal,
                "division": one.division,
                "outcome": one.outcome,
                "blocks": one.blocks,
                "compared": one.compared,
                "failed": one.failed,
            }
            for one in judged
        ],
        "static that serve every context": {f"{load:g}": statics(journal.figures, load) for load in HEAVY},
        "best static": [
            _best(story.name, load, journal, gated=gated)
            for story, gated in ((IMPORTANCE, False), (SUSPENDING, True))
            for load in HEAVY
        ],
        "losses of others": {f"{load:g}": losses_of_others(journal.figures, load) for load in HEAVY},
        "cells": [_row(cell, journal) for cell in dict.fromkeys(cell for cell, _, _ in journal.runs())],
        "tuned": [{**cell.values(), "shares": shares} for cell, shares in journal.tuned.items()],
    }


def _best(story: str, load: float, journal: Journal, *, gated: bool) -> dict[str, Any]:
    best = best_static(journal.figures, story, load, gated=gated)
    critical = best.figures.critical() if best else None
    return {"story": story, "load": load, "gated": gated, "division": best and best.division, "critical": critical}


def _row(cell: Cell, journal: Journal) -> dict[str, Any]:
    figures = journal.figures(cell)
    assert figures
    tasks = {
        name: {
            "hit": figures.hit(name),
            "blocks": figures.hits(name),
            "p50": _finite(figures.quantile(name, 0.5)),
            "p99": _finite(figures.quantile(name, 0.99)),
            "p99 blocks": [_finite(seconds) for seconds in figures.quantiles(name, 0.99)],
        }
        for name in figures.tasks
    }
    critical = {
        context.name: {"hit": hit, "blocks": figures.hits(context.critical, [context.name])}
        for context, hit in zip(figures.story.contexts, figures.critical().values(), strict=True)
    }
    whole = {"work": figures.work, "foreign": figures.foreign, "drain": figures.drain}
    return {**cell.values(), "critical": critical, "tasks": tasks, **whole}


def _finite(seconds: float) -> float | None:
    return seconds if math.isfinite(seconds) else None
