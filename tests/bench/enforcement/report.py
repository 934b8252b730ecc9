"""The figures as Markdown. Pure."""

from __future__ import annotations

import math
from itertools import groupby
from statistics import median
from typing import TYPE_CHECKING, Any

from tests.bench.enforcement.divisions import ALONE, CONTEXTUAL, STATIC
from tests.bench.enforcement.goals import FEWEST, Outcome, statics
from tests.bench.enforcement.inputs import Queue
from tests.bench.enforcement.intervals import RESAMPLES
from tests.bench.enforcement.matrix import HEAVY, LIGHT, LOADS, Cell, in_block
from tests.bench.enforcement.opponents import best_static, losses_of_others
from tests.bench.enforcement.stories import IMPORTANCE, PROCESSORS, SUSPENDING, critical_fit

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from tests.bench.enforcement.figures import Figures
    from tests.bench.enforcement.goals import Verdict
    from tests.bench.enforcement.journal import Journal
    from tests.bench.enforcement.opponents import Opponent

UNSETTLED = 0.02
"""Cores that others took: above this a run was disturbed."""
VIEWS = (
    (IMPORTANCE.name, "off", "Importance moves, nothing can be suspended"),
    (SUSPENDING.name, "off", "Contexts suspend, gating off: modules go on with what comes"),
    (SUSPENDING.name, "the same for all", "Contexts suspend, the same gating for all"),
    (SUSPENDING.name, "on", "Contexts suspend, gating on: the product as a whole against static divisions without it"),
)

LIGHT_VIEWS = (
    (IMPORTANCE.name, False, f"Load {LIGHT:g}, every task: nothing suspended"),
    (SUSPENDING.name, True, f"Load {LIGHT:g}, every task: contexts suspend, the same gating for all"),
)


def text(
    journal: Journal,
    measured: Sequence[Cell],
    left_out: Mapping[Cell, str],
    about: Mapping[str, Any],
    judged: Sequence[Verdict],
) -> str:
    """The whole report."""
    parts = [
        "# Enforcement: who gets the processors, and what it costs",
        _about(journal, measured, about),
        "## Goals",
        _JUDGED,
        "\n".join(_verdict(verdict) for verdict in judged),
        "\n".join(_statics(journal)),
        "\n".join(_others(journal)),
        *(part for story, gated, title in LIGHT_VIEWS for part in _light(journal, measured, story, title, gated=gated)),
        *(part for view in VIEWS for part in _view(journal, measured, *view)),
        "## Tuned static weights",
        _tuned(journal),
        "## Left out",
        _left_out(left_out),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


_JUDGED = f"""\
A goal is met if of {RESAMPLES:,} sets of blocks, drawn with replacement, the middle 95 % have every figure within its
bound, and missed if they have one figure beyond it. In between it is not shown, and so it is with fewer than {FEWEST}
blocks. A margin says how far a figure is within its bound, less than 0 that it is beyond."""


def _about(journal: Journal, measured: Sequence[Cell], about: Mapping[str, Any]) -> str:
    runs = [run for _, _, run in journal.runs()]
    disturbed = sum(run.foreign > UNSETTLED * len(run.responses["nav"]) * about["seconds"] for run in runs)
    late = max((run.late for run in runs), default=0.0)
    return f"""\
{about["machine"]}. {PROCESSORS} processors, contexts of {about["seconds"]:g} s, {about["blocks"]} blocks;
{len(runs)} runs; {_left(journal, measured, about["blocks"])}. In {disturbed} of the runs others took more than
{UNSETTLED:g} of a core. A context's last setting was written at most {late * 1000:.1f} ms after its beginning.

Hit rates are over all inputs due: what is dropped or never done is a miss. An input counts in the context in which it
arrives; only what arrives while its context suspends its task is not due, under every division alike. Hit rates and
quantiles are over all blocks; in brackets the median and the range of the blocks. Drain: after the last context, until
nothing waits for the tasks that it does not suspend. Work and others: the tasks' CPU seconds during the contexts, and
those that the rest of the machine took from them."""


def _left(journal: Journal, measured: Sequence[Cell], blocks: int) -> str:
    """How many planned runs are missing: more may have been measured than were planned."""
    planned = [(cell, block) for block in range(blocks) for cell in in_block(measured, block)]
    left = sum(not journal.has(cell, block) for cell, block in planned)
    return f"{left} of the {len(planned)} planned are left" if left else "none of the planned are left"


def _verdict(verdict: Verdict) -> str:
    word = f"**{verdict.outcome}**" if verdict.outcome in {Outcome.MISSED, Outcome.NOT_COMPARABLE} else verdict.outcome
    blocks = f" ({verdict.blocks} blocks)" if verdict.compared else ""
    failed = "".join(f"\n  - {failure}" for failure in verdict.failed)
    return f"- {verdict.goal}: {verdict.division}: {word}{blocks}{failed}"


def _statics(journal: Journal) -> Iterable[str]:
    for load in HEAVY:
        found = statics(journal.figures, load)
        best = best_static(journal.figures, IMPORTANCE.name, load, gated=False)
        if found and best:
            fit = "fit" if critical_fit(load) else "do not fit"
            by_outcome = {one: [name for name, outcome in found.items() if outcome is one] for one in Outcome}
            names = "; ".join(f"{one}: {', '.join(named)}" for one, named in by_outcome.items() if named)
            yield (
                f"- load {load:g} (the critical tasks {fit} together): the same of static divisions: {names}; "
                f"the best is {_opponent(best)}"
            )


def _others(journal: Journal) -> Iterable[str]:
    for load in HEAVY:
        best = best_static(journal.figures, SUSPENDING.name, load, gated=True)
        losses = losses_of_others(journal.figures, load)
        if best and losses:
            listed = ", ".join(f"{name} {-loss * 100:+.1f}" for name, loss in losses.items())
            yield f"- load {load:g}, equal gating: the best static is {_opponent(best)}"
            yield f"  - the others under context weights, against it, in points: {listed}"


def _opponent(best: Opponent) -> str:
    """A static division with its figures."""
    hits = ", ".join(f"{context} {_percent(hit)}" for context, hit in best.figures.critical().items())
    return f"{best.division} ({hits}; runs: {len(best.figures.runs)})"


def _light(journal: Journal, measured: Sequence[Cell], story: str, title: str, *, gated: bool) -> Iterable[str]:
    """Light load: every task under every division, with the least and the most of its blocks."""
    names = list(dict.fromkeys(cell.division for cell in measured if cell.division != ALONE))
    shown = {name: journal.figures(Cell(story, LIGHT, Queue.NEWEST, gated, name)) for name in names}
    found = {name: figures for name, figures in shown.items() if figures}
    if found:
        tasks = next(iter(found.values())).tasks
        head = ["", "blocks", *(f"{task} hits %, p99 ms" for task in tasks)]
        rows = [[name, str(len(one.runs)), *(_ranges(one, task) for task in tasks)] for name, one in found.items()]
        yield f"## {title}"
        yield _rows([head, ["---"] * len(head), *rows])


def _ranges(figures: Figures, task: str) -> str:
    """A task's hit rate and p99 over all blocks, and in brackets the least and the most of one."""
    hits, times = figures.hits(task), figures.quantiles(task, 0.99)
    rate, slow = 100 * figures.hit(task), _milliseconds(figures.quantile(task, 0.99))
    return (
        f"{rate:.1f} ({100 * min(hits):.1f}-{100 * max(hits):.1f}), "
        f"{slow} ({_milliseconds(min(times))}-{_milliseconds(max(times))})"
    )


def _view(journal: Journal, measured: Sequence[Cell], story: str, gating: str, title: str) -> Iterable[str]:
    """One comparison: a table for each load and queue."""
    names = list(dict.fromkeys(cell.division for cell in measured))
    tables = []
    for load in LOADS:
        for queue in Queue:
            shown = {name: journal.figures(_cell(story, load, queue, gating, name)) for name in names}
            found = {name: figures for name, figures in shown.items() if figures}
            if found.keys() - {ALONE} and (story == IMPORTANCE.name or any(name in CONTEXTUAL for name in found)):
                tables.append(f"### Load {load:g}, {queue}\n\n{_table(found)}")
    return [f"## {title}", *tables] if tables else []


def _cell(story: str, load: float, queue: Queue, gating: str, name: str) -> Cell:
    """Static divisions gate only where all do."""
    static = name in (*STATIC, ALONE)
    gated = gating == "the same for all" or (gating == "on" and not static)
    return Cell(story, load, queue, gated, name)


def _table(found: Mapping[str, Figures]) -> str:
    first = next(iter(found.values()))
    critical = [f"{context.name}: {context.critical}" for context in first.story.contexts]
    head = ["", *critical, *(f"{name} (all)" for name in first.tasks), "p50 / p99 ms", "work", "others", "drain"]
    return _rows([head, ["---"] * len(head), *(_cells(name, figures) for name, figures in found.items())])


def _rows(rows: Iterable[Sequence[str]]) -> str:
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def _cells(name: str, figures: Figures) -> list[str]:
    critical = [
        f"{_percent(figures.hit(context.critical, [context.name]))} "
        f"({_spread(figures.hits(context.critical, [context.name]))})"
        for context in figures.story.contexts
    ]
    times = "; ".join(
        f"{task} {_milliseconds(figures.quantile(task, 0.5))} / {_milliseconds(figures.quantile(task, 0.99))}"
        for task in figures.tasks
    )
    drain = "too long" if figures.drain is None else f"{figures.drain:.2f} s"
    return [
        name,
        *critical,
        *(_percent(figures.hit(task)) for task in figures.tasks),
        times,
        f"{figures.work:.2f} s",
        f"{figures.foreign:.2f} s",
        drain,
    ]


def _tuned(journal: Journal) -> str:
    lines = []
    for cell, shares in journal.tuned.items():
        lines.append(f"- {cell}: {_weights(shares)}")
        for trial in journal.trials[cell]:
            hit = ", ".join(f"{name} {_percent(rate)}" for name, rate in trial["critical"].items())
            worst, runs = _percent(trial["simulated"]), trial.get("runs", 1)  # once each had one
            lines.append(f"  - {_weights(trial['shares'])}: worst {worst} simulated; at worst in {runs} runs: {hit}")
    return "\n".join(lines)


def _weights(shares: Mapping[str, int]) -> str:
    return " ".join(f"{name} {amount}" for name, amount in shares.items())


def _left_out(left_out: Mapping[Cell, str]) -> str:
    reasons = groupby(sorted(left_out.items(), key=lambda one: one[1]), key=lambda one: one[1])
    return "\n".join(f"- {len(list(cells))} cells: {reason}" for reason, cells in reasons)


def _percent(rate: float) -> str:
    return "-" if math.isnan(rate) else f"{rate * 100:.1f} %"


def _spread(rates: Sequence[float]) -> str:
    known = [rate for rate in rates if not math.isnan(rate)]
    return f"{median(known) * 100:.0f}, {min(known) * 100:.0f}-{max(known) * 100:.0f}" if known else "-"


def _milliseconds(seconds: float) -> str:
    return "never" if math.isinf(seconds) else f"{seconds * 1000:.1f}"
