"""The report's tables, as Markdown. Pure."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING

from timelines.experiments import rates
from timelines.experiments.accounting import Ending, Tally
from timelines.experiments.blocks import HEAVY, PAPERS_LOAD, PLAN, SWEEP, UNSLOWED
from timelines.experiments.calibration import LOADS
from timelines.experiments.configurations import ALONE, CONFIGURATIONS, DIVISIONS, LINUX, LINUX_GATED, PAPERS
from timelines.experiments.paired import bootstrap
from timelines.experiments.stories import HELD_OUT, PAPER, PROTECTED

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from timelines.experiments.configurations import Configuration
    from timelines.experiments.evidence import Evidence
    from timelines.experiments.metrics import Run
    from timelines.experiments.paired import Interval
    from timelines.experiments.record import Record
    from timelines.experiments.verdicts import Verdict

NONE = "-"
CONTENDING = ("slam", "signs", "signs-left", "speech", "arm")
"""The tasks that have to share."""
MOVING = "drive"
"""The context in which the wheels turn."""
JUDGED = {
    "read: signs": "signs read while reading, %",
    "signs": "signs read, %",
    "speech": "commands heard, %",
}
"""The tasks whose results are right or wrong, and one of them in its context, with their measure."""
WORK = "work of the same inputs"
"""A row's head: in percent of that at the heavy load."""
TALKING = "talk: speech"
"""The task that listens to commands, in the context in which it matters most."""
TAKEN = "of the tasks' CPU used, %"
"""A column's head; the tasks' CPU is what slows the processors leaves them."""


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [list(head), ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def short(value: float) -> str:
    """Three digits, and never an exponent."""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{float(f'{value:.3g}'):.3f}".rstrip("0").rstrip(".") or "0"


def percent(found: Interval | None) -> str:
    """A rate with its interval, unless the ends of that are printed alike."""
    if found is None:
        return NONE
    mean, low, high = (f"{100 * one:.1f}" for one in (found.mean, found.low, found.high))
    return mean if low == high else f"{mean} [{low}, {high}]"


def runs_of(evidence: Evidence, load: str, names: Iterable[str] = CONFIGURATIONS) -> dict[str, list[Run]]:
    """The runs of a load's stories by configuration, in the order of `names`: those held out, or the paper's."""
    stories = PAPER if load in (PAPERS_LOAD, UNSLOWED) else HELD_OUT
    found = {name: [run for story in stories for run in evidence.of(load, story.name, name)] for name in names}
    return {name: runs for name, runs in found.items() if runs}


def sweep(evidence: Evidence) -> str:
    """The worst context's hit rate, by load and division. Empty where only one load was run."""
    loads = [load for load in sorted((HEAVY, *SWEEP), key=LOADS.__getitem__) if runs_of(evidence, load)]
    if len(loads) < 2:
        return ""
    found = {load: runs_of(evidence, load) for load in loads}
    rows = [
        [one.title, *(percent(rates.worst_context(found[load].get(one.name, ()))) for load in loads)]
        for one in DIVISIONS
    ]
    head = ["", *(f"{LOADS[load]:g}" for load in loads)]
    return table(
        head, [_counts(found), *rows, [WORK, *(_work_of_same(own, found.get(HEAVY, {})) for own in found.values())]]
    )


def _work_of_same(own: Mapping[str, Sequence[Run]], heavy: Mapping[str, Sequence[Run]]) -> str:
    """Under Linux default, which every load has; where another machine does the same in less, its load is smaller."""
    part = rates.work_of_same(own.get(LINUX.name, ()), heavy.get(LINUX.name, ()))
    return NONE if part is None else f"{100 * part:.0f}"


def _counts(found: Mapping[str, Mapping[str, Sequence[Run]]]) -> list[str]:
    return ["blocks", *(_blocks([run for runs in own.values() for run in runs]) for own in found.values())]


def goals(found: Iterable[Verdict]) -> str:
    """Each goal with its least sure case."""
    rows = []
    for one in found:
        case = one.worst
        measured = f"{case.name}: {short(case.value)} against {short(case.base)}" if case else NONE
        better = gain(case.gain) if case else NONE
        rows.append([one.goal.load, one.goal.name, measured, better, f"{one.probability:.3g}", _word(one)])
    return table(["load", "goal", "least sure case", "margin", "p (Holm)", ""], rows)


def _word(found: Verdict) -> str:
    if found.met is None and found.enough:
        return "not shown"
    if found.met is None:
        return "too few blocks" if found.cases else "not measured"
    return "met" if found.met else "**missed**"


def gain(found: Interval) -> str:
    """A margin with its interval."""
    return f"{found.mean:+.3g} [{found.low:+.3g}, {found.high:+.3g}]"


def of_load(evidence: Evidence, load: str, names: Iterable[str] = CONFIGURATIONS, *, cpu: bool = True) -> str:
    """A row for each configuration: hit rates in percent, and CPU used unless that is left out. Empty without runs."""
    found = runs_of(evidence, load, names)
    about = rates.by_context(run.schedule for runs in found.values() for run in runs)
    head = ["", "blocks", *(f"{context}: {task}" for context, task in about.items()), *PROTECTED]
    head += [TAKEN, "cores used by the control", "by all else"] if cpu else []
    rows = []
    for name, runs in found.items():
        hits = [percent(rates.critical(runs, context, task)) for context, task in about.items()]
        hits += [percent(rates.whole(runs, task)) for task in PROTECTED]
        rows.append([CONFIGURATIONS[name].title, _blocks(runs), *hits, *(_cpu(name, runs) if cpu else ())])
    absent = _absent(evidence, load, found)
    rows += [[CONFIGURATIONS[name].title, "not run", *[NONE] * (len(head) - 2)] for name in absent]
    return table(head, rows) if found else ""


def all_runs(evidence: Evidence) -> list[Record]:
    """All runs, in no order that matters."""
    return [record for blocks in evidence.runs.values() for record in blocks.values()]


def costs(evidence: Evidence, load: str, names: Iterable[str] = CONFIGURATIONS, *, alike: bool = True) -> str:
    """What was done in time of all that came, in percent, and how right it was: what each division costs whom.

    Without `alike` only columns in which divisions differ, and the last one.
    """
    found = runs_of(evidence, load, names)
    compared = [run for runs in found.values() for run in runs]
    sharing = [task for task in CONTENDING if any(task in run.schedule.inputs for run in compared)]
    judged = {task: what for task, what in JUDGED.items() if any(task in run.record.accuracy for run in compared)}
    rows = []
    for name, runs in found.items():
        done = [in_time(rates.endings(runs, task)) for task in sharing]
        rows.append([CONFIGURATIONS[name].title, *done, *(_right(runs, task) for task in judged), _cpu(name, runs)[0]])
    columns = list(zip(["", *sharing, *judged.values(), TAKEN], *rows, strict=True))
    shown = [one for one in columns if alike or one[0] in ("", TAKEN) or len(set(one[1:])) > 1]
    head, *lines = zip(*shown, strict=True)
    return table(head, lines) if rows else ""


def in_time(counts: Mapping[Ending, float]) -> str:
    """The part that was done in time, in percent."""
    return f"{100 * counts[Ending.IN_TIME] / math.fsum(counts.values()):.1f}"


def _right(runs: Sequence[Run], task: str) -> str:
    found = rates.right(runs, task)
    return f"{found.mean:.1f}" if found else NONE


def heard(evidence: Evidence, load: str, names: Iterable[str]) -> str:
    """How many commands were heard while talking: what a hit rate does not have. Empty without any."""
    found = ((name, rates.right(runs, TALKING)) for name, runs in runs_of(evidence, load, names).items())
    said = "; ".join(f"{CONFIGURATIONS[name].title} {one.mean:.1f}" for name, one in found if one)
    return f"Commands heard while talking, % (no goal): {said}.\n" if said else ""


def _absent(evidence: Evidence, load: str, found: Iterable[str]) -> list[str]:
    """The configurations of which a load has no run at all, though there should be some."""
    return sorted({one.configuration for one in evidence.absent if one.load == load} - set(found))


def absences(evidence: Evidence) -> str:
    """A line for each reason for which runs could not be done. Empty where all were."""
    counts = Counter((one.configuration, one.load, one.reason) for one in evidence.absent)
    return "".join(
        f"- {CONFIGURATIONS[name].title}, {load} load, {count} {'run' if count == 1 else 'runs'}: not run: {reason}.\n"
        for (name, load, reason), count in counts.items()
    )


def not_yet(evidence: Evidence) -> str:
    """What the plan has and was not begun, by load. Empty where all was."""
    lacking: dict[str, list[str]] = {}
    begun = {load for load, _, _ in evidence.runs}
    for part in PLAN:
        run = runs_of(evidence, part.load)
        titles = [one.title for one in part.configurations if one.name not in run]
        if titles:
            lacking.setdefault(f"{part.load} load", []).extend(titles if part.load in begun else ())
    return ", ".join(f"{load} ({'; '.join(titles)})" if titles else load for load, titles in lacking.items())


def alone(evidence: Evidence) -> str:
    """How often each task was run alone, and how blocks are compared with that. Empty without any."""
    counts = {
        len(runs) for (load, _, name), runs in evidence.runs.items() if name == ALONE.name and load != PAPERS_LOAD
    }
    if not counts:
        return ""
    times = " or ".join(str(one) for one in sorted(counts))
    return (
        f"Runs of each task alone by story and load: {times}. In each case every block is compared with the stricter"
        " of them.\n"
    )


def _blocks(runs: Sequence[Run]) -> str:
    return str(len({run.record.block for run in runs}))


def _cpu(name: str, runs: Sequence[Run]) -> list[str]:
    """Where each task is played by itself, a run is as many times as long: its CPU compares with nobody's."""
    if name == ALONE.name:
        return [NONE] * 3
    others = (rates.used(runs, rates.CONTROL), rates.used_by_all_else(runs))
    return [f"{100 * rates.exhausted(runs, runs[0].schedule.inputs):.0f}", *(f"{value:.2f}" for value in others)]


def chains(evidence: Evidence, load: str, names: Iterable[str] = CONFIGURATIONS) -> str:
    """From the camera, and from a spoken "stop", to the wheels while the robot drives."""
    rows = []
    for name, runs in runs_of(evidence, load, names).items():
        if name == ALONE.name:
            continue  # nobody hears the mission there
        chain = [_milliseconds(rates.command_latency(runs, MOVING, part)) for part in (0.5, 0.99)]
        said, heard = rates.stops(runs, MOVING)
        stop = [f"{heard} of {said}", _milliseconds(rates.stop_latency(runs, MOVING))]
        commanded = f"{100 * rates.commands(runs, MOVING):.1f} %"
        rows.append([CONFIGURATIONS[name].title, commanded, *chain, *stop])
    head = ["", "frames that led to a wheel command", "camera to wheels, median", "99 %"]
    return table([*head, "stops said then that led to an order", "median from the word's end"], rows) if rows else ""


def _milliseconds(found: Interval | None) -> str:
    if found is None:
        return NONE
    mean, low, high = (f"{1000 * one:.0f}" for one in (found.mean, found.low, found.high))
    return f"{mean} ms" if low == high else f"{mean} [{low}, {high}] ms"


def speedups(evidence: Evidence, against: Configuration = LINUX) -> Iterator[tuple[str, str, Interval]]:
    """The paper's measure, block by block: total time of Linux default divided by the configuration's.

    Against gated Linux default what remains is what CPU does: both leave the same inputs undone.
    """
    for story in PAPER:
        for one in PAPERS:
            pairs = [pair for _, pair in evidence.pairs(PAPERS_LOAD, one.name, against.name, [story])]
            ratios = [
                pair.base.about["finished"] / pair.record.about["finished"]
                for pair in pairs
                if pair.record.about["drained"] and pair.base.about["drained"]
            ]
            if ratios and one is not against:
                yield story.name, one.title, bootstrap(ratios)


def totals(evidence: Evidence) -> str:
    """The speedups alone: a row for each configuration, a column for each story. Empty without runs."""
    found = {(story, title): speedup for story, title, speedup in speedups(evidence)}
    titles, stories = (list(dict.fromkeys(cell[place] for cell in found)) for place in (1, 0))
    rows = [[title, *(_times(found.get((story, title))) for story in stories)] for title in titles]
    counts = [str(max(one.pairs for (own, _), one in found.items() if own == story)) for story in stories]
    return table(["", *stories], [["blocks", *counts], *rows]) if rows else ""


def papers(evidence: Evidence) -> str:
    """Total times, and the work that was done in them. Empty without runs.

    Runs that were given up while inputs waited have no total time: they are counted, and take no part.
    """
    found, gated = (
        {(story, title): speedup for story, title, speedup in speedups(evidence, against)}
        for against in (LINUX, LINUX_GATED)
    )
    rows = []
    for story in PAPER:
        for one in PAPERS:
            runs = evidence.of(PAPERS_LOAD, story.name, one.name)
            if runs:
                speedup = found.get((story.name, one.title))
                times = [_times(speedup), _times(gated.get((story.name, one.title)) if one.gated else None)]
                rows.append([story.name, one.title, *times, *_work(runs), *_counted(runs, speedup)])
    head = ["", "", "times as fast as Linux default", "as Linux default, gated"]
    head += ["done, % of all inputs", "suspended, %", "blocks compared", "runs given up"]
    return table(head, rows) if rows else ""


def _times(speedup: Interval | None) -> str:
    if speedup is None:
        return NONE
    mean, low, high = (f"{one:.2f}" for one in (speedup.mean, speedup.low, speedup.high))
    return mean if low == high else f"{mean} [{low}, {high}]"


def _work(runs: Sequence[Run]) -> list[str]:
    """A total time is short where little was done: how many of all inputs were, and how many were suspended."""
    every = Tally.of(end.ending for run in runs for task in run.schedule.inputs for end in run.ended(task))
    return [f"{100 * part:.1f}" for part in (every.coverage, every.count(Ending.SUSPENDED) / every.due)]


def _counted(runs: Sequence[Run], speedup: Interval | None) -> list[str]:
    return [str(speedup.pairs) if speedup else NONE, str(sum(not run.record.about["drained"] for run in runs))]
