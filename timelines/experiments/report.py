"""Writes the report: two pages (report.md), the rest as data (details.md), and pictures; all from committed records."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from timelines.experiments import detail_tables, doubts, pictures, rates, tables
from timelines.experiments.blocks import HEAVY, LIGHT, PAPERS_LOAD, SWEEP, UNSLOWED
from timelines.experiments.capacity import Capacity
from timelines.experiments.configurations import (
    CONFIGURATIONS,
    DIVISIONS,
    FACTORS,
    LINUX,
    REALTIME,
    STATIC,
    WEIGHTS,
    WEIGHTS_GATED,
)
from timelines.experiments.goals import GOALS, SIGNIFICANT, SPEEDUP, Goal
from timelines.experiments.report_texts import (
    CORES,
    COSTS,
    METHOD,
    REPEAT,
    RIVALRY,
    SWEPT,
    THREATS,
    UNDONE,
    VARIED,
)
from timelines.experiments.stories import HELD_OUT
from timelines.experiments.verdicts import judged, verdicts

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from timelines.experiments.evidence import Evidence
    from timelines.experiments.record import Record
    from timelines.experiments.verdicts import Verdict

SHOWN = [one.name for one in DIVISIONS]
"""What the report compares throughout; details.md has all configurations."""
FIRST_PAGE = [one.name for one in FACTORS]
"""What its tables of hit rates have."""
RIVALS = (("drive", "slam"), ("read", "signs"))
"""The two tasks that contend, each with the context in which it matters most."""
SPARE = "signs-left"
"""What is done where CPU is left."""
CALIBRATED = "what-was-calibrated-and-then-frozen"
"""Where the details have it."""


def write_report(evidence: Evidence, out: Path) -> Path:
    """Write the report of all runs, and what belongs to it, into a folder."""
    (out / "figures").mkdir(parents=True, exist_ok=True)
    found = verdicts(evidence)
    path = out / "report.md"
    pages = [*_first_page(evidence, found), *_second_page(evidence, out / "figures")]
    path.write_text("\n".join(pages), encoding="utf-8")
    (out / "details.md").write_text("\n".join(_details(evidence, found, out / "figures")), encoding="utf-8")
    return path


def _first_page(evidence: Evidence, found: Sequence[Verdict]) -> Iterator[str]:
    yield "# What a robot gains from contexts\n"
    yield f"{_headline(evidence)}{_claim(found)}\n"
    yield f"{METHOD}\n{_machine(evidence)}"
    for load in (HEAVY, LIGHT):
        rows = tables.of_load(evidence, load, FIRST_PAGE, cpu=False)
        if rows:
            yield f"## {load.capitalize()} load: hit rates in percent\n"
            yield rows
        if rows and load == HEAVY:
            yield COSTS
            yield tables.costs(evidence, load, SHOWN, alike=False)
        if load == LIGHT:
            yield tables.heard(evidence, load, FIRST_PAGE)
    absent = tables.absences(evidence)
    if absent:
        yield absent
    not_yet = tables.not_yet(evidence)
    if not_yet:
        yield f"Not run yet: {not_yet}.\n"
    yield "## Goals of context weights, gated unless nothing is suspended\n"
    yield tables.goals(found)
    yield _static(evidence)


def _headline(evidence: Evidence) -> str:
    """What happened to the two tasks that contend, each where it matters most, and over whole stories."""
    runs = tables.runs_of(evidence, HEAVY, [one.name for one in (WEIGHTS, STATIC, LINUX)])
    found = {name: [rates.critical(own, context, task) for context, task in RIVALS] for name, own in runs.items()}
    if len(runs) < 3 or not all(all(own) for own in found.values()):
        return ""
    hits = {name: " and ".join(f"{100 * one.mean:.1f}" for one in own if one) for name, own in found.items()}
    every = {
        name: " and ".join(tables.in_time(rates.endings(own, task)) for _, task in RIVALS) for name, own in runs.items()
    }
    left = {name: tables.in_time(rates.endings(own, SPARE)) for name, own in runs.items()}
    return (
        f"Under heavy load **context weights did {hits[WEIGHTS.name]} % of SLAM's frames while driving and of signs'"
        f" pictures while reading in time**, the best static weights that were found {hits[STATIC.name]} %, Linux"
        f" default {hits[LINUX.name]} %. Somebody pays: of all frames and pictures to the right context weights did"
        f" {every[WEIGHTS.name]} %, static weights {every[STATIC.name]} %, of those to the left, which never matter"
        f" most, {left[WEIGHTS.name]} and {left[STATIC.name]} %.\n\n"
    )


def _claim(found: Sequence[Verdict]) -> str:
    """How many goals are met, and which are not."""
    met = [one for one in found if one.met]
    missed = [one for one in found if one.met is False]
    unshown = [one for one in found if one.met is None and one.enough]
    decided = len(met) + len(missed) + len(unshown)
    if not decided:
        return "No goal has been decided yet."
    said = f"**{len(met)} of {len(found)} goals are met**"
    open_ = len(found) - decided
    rest = [f"{len(missed)} missed"] if missed else []
    rest += [f"{len(unshown)} not shown"] if unshown else []
    rest += [f"{open_} not measured, or in too few blocks"] if open_ else []
    rest.append("see [which](#goals-of-context-weights-gated-unless-nothing-is-suspended)")
    return f"{said} ({'; '.join(rest)})."


def _machine(evidence: Evidence) -> str:
    every = tables.all_runs(evidence)
    machines = {"{processor}, {cores} cores, Linux {kernel}".format(**one.about["machine"]) for one in every}
    dates, loads = sorted(one.about["date"][:10] for one in every), evidence.frozen.get("loads")
    words = [f"Machine: {'; '.join(sorted(machines))}. {len(every)} runs, {dates[0]} to {dates[-1]}. {_code(every)}"]
    if not loads:
        used = sorted({f"{one.load} load: {Capacity(*one.about['capacity'])}" for one in every})
        return f"{words[0]} **Nothing was calibrated: a quick look** ({', '.join(used)}).\n"
    asked, played = evidence.frozen["asked"], {one.load for one in every}
    shared = (
        f"{load} load {asked[load]:g} times {Capacity(*own)} processors"
        for load, own in loads.items()
        if load in played
    )
    words.append(f"The tasks want: {', '.join(shared)} ([at what pace](details.md#{CALIBRATED})).")
    return " ".join(words) + "\n"


def _code(every: Sequence[Record]) -> str:
    """The commit that ran, or how many did."""
    codes = {str(one.about["code"]) for one in every}
    if len(codes) == 1:
        return f"Code: commit {codes.pop()}."
    return f"Code: [{len(codes)} commits](details.md#which-code-was-run)."


def _codes(every: Sequence[Record]) -> str:
    """With how many runs of which load each commit has."""
    counts = Counter((one.load, str(one.about["code"])) for one in every)
    return tables.table(["load", "commit", "runs"], ([*which, str(count)] for which, count in sorted(counts.items())))


def _static(evidence: Evidence) -> str:
    """Which divisions reach what context weights are asked for: where a static one does, contexts gain no deadlines."""
    lines = []
    for goal in GOALS:
        if goal.metric == "critical hit rate" and goal.configuration in (WEIGHTS.name, WEIGHTS_GATED.name):
            gated = CONFIGURATIONS[goal.configuration].gated
            found = {one.title: _reaches(evidence, goal, one.name) for one in FACTORS if one.gated is gated}
            reach = [title for title, reached in found.items() if reached]
            none = (
                "none of those that were measured" if False in found.values() else "not measured, or in too few blocks"
            )
            lines.append(f"- {'gated' if gated else 'nothing suspended'}: {', '.join(reach) or none}.\n")
    return "The critical tasks' goal is reached (uncorrected) by:\n\n" + "".join(lines)


def _reaches(evidence: Evidence, goal: Goal, configuration: str) -> bool | None:
    """None where nothing was measured, or too little to be sure."""
    cases = judged(evidence, Goal(goal.name, goal.load, configuration, goal.against, goal.metric, offset=goal.offset))
    if not cases or 0.5 ** min(case.gain.pairs for case in cases) > SIGNIFICANT:
        return None
    return max(case.probability for case in cases) <= SIGNIFICANT


def _second_page(evidence: Evidence, figures: Path) -> Iterator[str]:
    if pictures.draw_factors(evidence, HEAVY, figures / "factors-heavy.svg"):
        yield "## What each factor does\n"
        yield "![Hit rates of the critical tasks by configuration, heavy load](figures/factors-heavy.svg)\n"
    if pictures.draw_responses(evidence, HEAVY, figures / "responses.svg"):
        yield "![Response times of the critical tasks as cumulated parts of what was due](figures/responses.svg)\n"
    if sweep := tables.sweep(evidence):
        yield "## From which load on contexts help: the worst context, in percent\n"
        yield f"{SWEPT}\n{sweep}"
    chains = tables.chains(evidence, HEAVY, SHOWN)
    if chains:
        yield "## From the camera, and from a word, to the wheels while driving; heavy load\n"
        yield chains
    totals = tables.totals(evidence)
    if totals:
        yield "## The paper's measure: queues lose nothing, a run ends when they are empty\n"
        yield f"Total time of Linux default divided by each configuration's (the paper: up to {SPEEDUP}); {UNDONE}:\n"
        yield totals
    yield f"## Threats to validity\n\n{THREATS}"
    yield f"## Repeat it\n\n{REPEAT}"
    yield "[Details](details.md).\n"


def _details(evidence: Evidence, found: Sequence[Verdict], figures: Path) -> Iterator[str]:
    yield "# Details of the experiments\n"
    if "loads" in evidence.frozen:
        yield "## What was calibrated, and then frozen\n"
        yield detail_tables.calibrated(evidence.frozen, tables.all_runs(evidence)[0].about["machine"]["cores"])
        yield detail_tables.paces(evidence)
    yield tables.alone(evidence)
    yield "## Which code was run\n"
    yield _codes(tables.all_runs(evidence))
    yield "## What the machine was measured to do\n"
    yield detail_tables.measures(evidence)
    for load in (HEAVY, LIGHT, *SWEEP, PAPERS_LOAD):
        if tables.runs_of(evidence, load):
            yield from _details_of_load(evidence, load)
    predicted = detail_tables.predictions(evidence)
    if predicted:
        yield "## Prediction, experimental: `contextpolicy simulate --profiles` before the runs, heavy load\n"
        yield predicted
    if pictures.draw_rivals(evidence, figures / "static.svg"):
        yield "## What static weights do for two tasks\n"
        yield RIVALRY
        yield "![Signs in time while reading against SLAM while driving, by set of weights](figures/static.svg)\n"
    yield "## Reasons to doubt single runs\n"
    yield doubts.doubts(evidence) or "None.\n"
    yield doubts.rejected(evidence)
    yield from _as_first_played(evidence)
    yield "## Without the first heavy block, after which three measures were changed\n"
    yield tables.goals(verdicts(doubts.without_first_block(evidence)))
    yield "## Every case of every goal\n"
    for verdict in found:
        yield f"### {verdict.goal.name}, {verdict.goal.load} load\n"
        yield detail_tables.cases(verdict)
    if pictures.draw_factors(evidence, LIGHT, figures / "factors-light.svg"):
        yield "![Hit rates of the critical tasks by configuration, light load](figures/factors-light.svg)\n"
    if pictures.draw_speedups(evidence, figures / "times.svg"):
        yield "![Total time of Linux default divided by each configuration's](figures/times.svg)\n"
    for name, what in _drawn(evidence, figures):
        yield f"![{what}](figures/{name})\n"


def _as_first_played(evidence: Evidence) -> Iterator[str]:
    """Whether repeating runs has changed the results."""
    first = doubts.as_first_played(evidence)
    if evidence.rejected:
        yield "## If each run's first attempt counted\n"
        yield tables.goals(verdicts(first))
        for load in (HEAVY, LIGHT, PAPERS_LOAD):
            yield f"{load.capitalize()} load:\n"
            yield tables.of_load(first, load)
        yield "The worst context by load:\n"
        yield tables.sweep(first)
        yield "The paper's total times:\n"
        yield tables.papers(first)


def _details_of_load(evidence: Evidence, load: str) -> Iterator[str]:
    yield f"## {load.capitalize()} load\n"
    yield "### Hit rates in percent\n"
    yield tables.of_load(evidence, load)
    yield CORES
    if load == HEAVY:
        yield VARIED
    if load == PAPERS_LOAD:
        yield "### Total times, and the work that was done in them\n"
        yield tables.papers(evidence)
    if load == HEAVY:
        yield "### What was done in time of all that came, wanted or not\n"
        yield tables.costs(evidence, load)
        yield "### From the camera, and from a word, to the wheels\n"
        yield tables.chains(evidence, load)
    yield "### How every input ended, in percent of what was due\n"
    yield detail_tables.endings(evidence, load)
    yield "### Critical tasks at the onset of their contexts, hit rates in percent\n"
    yield detail_tables.onsets(evidence, load)
    yield "### How right each task was\n"
    yield detail_tables.accuracies(evidence, load)
    yield "### The player, and the machine\n"
    yield detail_tables.player(evidence, load)


def _drawn(evidence: Evidence, figures: Path) -> Iterator[tuple[str, str]]:
    """The paper's figures again: what the camera sees, what was used and what was decided; file and words."""
    story = HELD_OUT[0].name
    film, plain = evidence.films.get(story), evidence.of(HEAVY, story, LINUX.name)
    if film and plain:
        pictures.draw_film(plain[0], film, figures / "film.svg")
        yield "film.svg", "Contexts over time, and what the camera sees"
    for load, where, one in [*((HEAVY, story, one) for one in FACTORS), (UNSLOWED, "exp2", REALTIME)]:
        for run in evidence.of(load, where, one.name)[:1]:
            pictures.draw_use(run, figures / f"used-{one.name}.svg")
            yield f"used-{one.name}.svg", f"{one.title}: CPU that each task used over time"
            if run.record.plans and one.contextual:
                pictures.draw_decisions(run, figures / f"decided-{one.name}.svg")
                yield f"decided-{one.name}.svg", f"{one.title}: contexts, weights and shares over time"
