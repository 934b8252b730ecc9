"""Reasons to doubt what was measured: runs that are named, and attempts that do not count. Pure, as Markdown."""

from __future__ import annotations

import datetime as dt
from dataclasses import replace
from statistics import fmean
from typing import TYPE_CHECKING

from timelines.experiments.blocks import HEAVY, part_of
from timelines.experiments.configurations import ALONE, CONFIGURATIONS
from timelines.experiments.earlier import Earlier
from timelines.experiments.metrics import Run, contexts
from timelines.experiments.tables import all_runs, table

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from timelines.experiments.evidence import Evidence
    from timelines.experiments.record import Record

APART = dt.timedelta(hours=2)
"""Between a block's first run and its last: beyond this it was interrupted."""
KEPT = 250
"""Characters of a reason that a run's own list surely has: it keeps so many more, and the error's name among them."""


def doubts(evidence: Evidence) -> str:
    """A line for each reason to doubt the runs. Empty without any."""
    runs = all_runs(evidence)
    single = (*_given_up(runs), *_begun_again(evidence), *_violated(runs), *_off(evidence))
    return "".join((*single, *_mixed(runs)))


def _given_up(every: Iterable[Record]) -> Iterator[str]:
    for one in every:
        if not one.about["drained"]:
            yield (
                f"- {_name(one)}: inputs still waited when it was given up; it takes no part in comparisons of"
                " total times.\n"
            )


def _begun_again(evidence: Evidence) -> Iterator[str]:
    for one in all_runs(evidence):
        if failures := [*one.about["failures"], *_set_aside(evidence, one)]:
            reasons = "; ".join(dict.fromkeys(" ".join(reason.split()) for reason in failures))
            yield f"- {_name(one)}: begun {len(failures) + 1} times: {reasons}.\n"


def _set_aside(evidence: Evidence, one: Record) -> Iterator[str]:
    """Why earlier attempts do not count of which a run does not know, since it was played again later."""
    known = " ".join(one.about["failures"])
    for other in evidence.rejected:
        same = (other.load, other.story, other.configuration, other.block)
        if same == (one.load, one.story, one.configuration, one.block):
            yield from (reason for reason in other.about["failures"] if reason[:KEPT] not in known)


def _violated(every: Iterable[Record]) -> Iterator[str]:
    for one in every:
        if violations := one.about["violations"]:
            yield f"- {_name(one)}: counted as it was, though {'; '.join(violations)}.\n"


def _off(evidence: Evidence) -> Iterator[str]:
    """Runs whose work is off by all runs that there are now; each was judged by those before it."""
    known = Earlier(evidence.every())
    for run in evidence.every():
        for reason in known.reasons(run):
            yield f"- {_name(run.record)}: counted as it was, though {reason}.\n"


def _mixed(every: Iterable[Record]) -> Iterator[str]:
    """Blocks of which the runs differ in more than the configuration, or are hours apart."""
    blocks: dict[tuple[int, str, int], list[Record]] = {}
    for one in every:
        blocks.setdefault((part_of(one.load, one.configuration), one.load, one.block), []).append(one)
    for (_, load, block), own in sorted(blocks.items()):
        codes = sorted({str(one.about["code"]) for one in own})
        kernels, processors = (
            sorted({str(one.about["machine"][what]) for one in own}) for what in ("kernel", "processor")
        )
        dates = sorted(dt.datetime.fromisoformat(one.about["date"]) for one in own)
        if max(len(codes), len(kernels), len(processors)) > 1 or dates[-1] - dates[0] > APART:
            yield (
                f"- {load} load, block {block + 1}: its runs are not all alike: code {', '.join(codes)};"
                f" kernel {', '.join(kernels)}; {', '.join(processors)}; {dates[0]:%F %H:%M} to {dates[-1]:%F %H:%M}.\n"
            )


def _name(one: Record) -> str:
    return f"{one.story}, {one.load} load, {CONFIGURATIONS[one.configuration].title}, block {one.block + 1}"


def as_first_played(evidence: Evidence) -> Evidence:
    """As if each run's first attempt that was recorded had counted, whatever was wrong with it."""
    runs = {cell: dict(own) for cell, own in evidence.runs.items()}
    for one in sorted(evidence.rejected, key=lambda one: str(one.about["date"]), reverse=True):
        own = runs.get((one.load, one.story, one.configuration), {})
        if one.block in own:
            own[one.block] = one
    return replace(evidence, runs=runs)


def without_first_block(evidence: Evidence) -> Evidence:
    """As if the heavy block after which some measures were changed had not been run; each task alone came later."""
    runs = {
        (load, story, name): {block: one for block, one in own.items() if block or load != HEAVY or name == ALONE.name}
        for (load, story, name), own in evidence.runs.items()
    }
    return replace(evidence, runs=runs)


def rejected(evidence: Evidence) -> str:
    """Attempts that do not count: why, and what their critical tasks hit beside those that do. Empty without any."""
    rows = [
        [_name(one), "; ".join(one.about["failures"]), *(f"{100 * hit:.1f}" for hit in _hits(evidence, one))]
        for one in evidence.rejected
        if one.story in evidence.schedules
    ]
    head = ["attempts that do not count", "", "critical tasks hit, %", "in runs that count"]
    return table(head, rows) if rows else ""


def _hits(evidence: Evidence, one: Record) -> tuple[float, float]:
    """The mean over contexts of what the critical tasks hit in an attempt, and in the runs that count."""
    own = Run(evidence.schedules[one.story], one)
    counting = evidence.of(one.load, one.story, one.configuration)
    return _hit(own), fmean(_hit(run) for run in counting) if counting else float("nan")


def _hit(run: Run) -> float:
    return fmean(run.tally(task, context).hit for context, task in contexts(run.schedule).items())
