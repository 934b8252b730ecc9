"""Writes the report: two pages (report.md), the rest as data (details.md), and pictures; all from committed records."""

from __future__ import annotations

from collections import Counter
from statistics import fmean
from typing import TYPE_CHECKING

from timelines.experiments import detail_tables, doubts, pictures, tables
from timelines.experiments.blocks import HEAVY, LIGHT, PAPERS_LOAD, SWEEP, UNSLOWED
from timelines.experiments.capacity import Capacity
from timelines.experiments.configurations import (
    CONFIGURATIONS,
    DIVISIONS,
    FACTORS,
    LINUX,
    REALTIME,
    WEIGHTS,
    WEIGHTS_GATED,
)
from timelines.experiments.goals import GOALS, SIGNIFICANT, SPEEDUP, Goal
from timelines.experiments.stories import HELD_OUT
from timelines.experiments.verdicts import judged, verdicts

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from timelines.experiments.evidence import Evidence
    from timelines.experiments.record import Record
    from timelines.experiments.verdicts import Verdict

METHOD = """\
Every input of the timeline counts, the same in each run. Hit rates are over what the policy's contexts want, as its
simulation on the timeline finds them; what was dropped, lost or suspended although it was wanted is a miss. The block
is the unit: every configuration once per story, in random order. Brackets are 95 % bootstrap intervals over blocks; p
is of an exact sign-flip test over blocks, by Holm's correction for all goals, which were
[declared before the runs](../experiments/goals.py). Each goal's least sure case decides.
"""
SHOWN = [one.name for one in (*DIVISIONS, WEIGHTS_GATED)]
"""What the report compares throughout; details.md has all configurations."""
COSTS = """\
What was done in time of **all** that came, wanted by a context or not:
"""
THREATS = """\
- **Four earlier attempts** with other held-out stories are left out: goals were missed and the design was changed, and
  the machine was measured badly ([what they showed](../../docs/measurements/paper-experiments.md#earlier-attempts)).
  These stories were written afterwards, by the same people; p-values are of this attempt alone.
- The stories are invented, their recordings rendered or synthesised: they show how CPU is divided, not how well this
  robot would do in a building. Only SLAM and signs contend. Of the synthesised commands two in five are not
  recognised, also alone: such a "stop" stops nothing.
- **The load was chosen after pilots** on tuning stories in which static weights sufficed at 1.26 and failed at 1.4.
  Camera rates, queues, priorities, `min` and deadlines followed from pilots that context weights missed.
- Cores of a virtual server, kept at a pace by threads that judge it themselves. Runs whose work for the same inputs is
  over 12 % off are repeated; less goes unnoticed ([details.md](details.md) has all attempts).
- Caches and memory are not a board's. One kernel, cgroup v1, one kind of machine, blocks within days.
- Limits divide CPU time by the median speed of the latest runs, mostly of others and faster; they miss more where
  that is off ([details.md](details.md)). Runs are repeated where messages were lost or the player was late, which may
  depend on the configuration.
- The kubelet, the API server and the operator may run beside the tasks' processor: what control costs is then not in
  the hit rates. No context lasts the 30 s after which the API follows.
- Ten blocks may have nothing of what fails in one of ten; intervals of few are narrower than 95 %. Each task alone
  comes from few runs; the one that asks most counts as known. [Goals were
  changed](../../docs/measurements/paper-experiments.md#how-it-is-measured) after the first block.
- An input's CPU is what its process takes meanwhile. Latencies to the wheels are of commands that came.
- Navigation's accuracy is not judged. Linux default is what the chart requests, 10m a task; static weights were
  searched with it, those for lighter loads on two stories only. A VPA decides once a minute. SCHED_RR and pinning were
  not run.
"""
RIVALRY = """\
Each point is one set of weights that the search for static ones tried, on its first story, once. A set that keeps both
tasks is at the top right; where there is one, contexts are not needed.
"""
REPEAT = """\
    make experiments                                             # all of it; goes on where it stopped
    python -m timelines.experiments --report-only                # every figure here, from the committed data

"""


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
    yield _claim(found) + "\n"
    yield f"{METHOD}\n{_machine(evidence)}"
    for load in (HEAVY, LIGHT):
        rows = tables.of_load(evidence, load)
        if rows:
            yield f"## {load.capitalize()} load: hit rates in percent\n"
            yield rows
        if rows and load == HEAVY:
            yield COSTS
            yield tables.costs(evidence, load, SHOWN)
    absent = tables.absences(evidence)
    if absent:
        yield absent
    yield "## Goals of context weights, gated unless nothing is suspended\n"
    yield tables.goals(found)
    yield _static(evidence)


def _claim(found: Sequence[Verdict]) -> str:
    """What the goals say, in one sentence each way."""
    met = [one for one in found if one.met]
    missed = [one for one in found if one.met is False]
    unshown = [one for one in found if one.met is None and one.enough]
    decided = len(met) + len(missed) + len(unshown)
    if not decided:
        return "No goal has been decided yet."
    said = f"**{len(met)} of {decided} goals that are decided are met**"
    open_ = len(found) - decided
    rest = [f"missed: {'; '.join(one.goal.name for one in missed)}"] if missed else []
    rest += [f"neither met nor missed for sure: {'; '.join(one.goal.name for one in unshown)}"] if unshown else []
    rest += [f"not measured, or in too few blocks: {open_}"] if open_ else []
    return f"{said} ({'; '.join(rest)})." if rest else f"{said}."


def _machine(evidence: Evidence) -> str:
    every = tables.all_runs(evidence)
    machines = {
        "{processor}, {cores} cores, {memory_gib} GiB, Linux {kernel}".format(**one.about["machine"]) for one in every
    }
    dates, loads = sorted(one.about["date"][:10] for one in every), evidence.frozen.get("loads")
    words = [f"Machine: {'; '.join(sorted(machines))}. {len(every)} runs, {dates[0]} to {dates[-1]}. {_code(every)}"]
    if not loads:
        used = sorted({f"{one.load} load: {Capacity(*one.about['capacity'])}" for one in every})
        return f"{words[0]} **Nothing was calibrated: a quick look** ({', '.join(used)}).\n"
    asked = evidence.frozen["asked"]
    shared = (
        f"{load} load: {asked[load]:g} times what there is, {_capacity(every, load, *own)}"
        for load, own in loads.items()
    )
    words.append(
        f"Asked of the processors, and how many there are with which part of a whole one: {'; '.join(shared)}."
    )
    return " ".join(words) + "\n"


def _capacity(every: Sequence[Record], load: str, processors: int, part: float) -> str:
    """What the tasks should share, and what they could do on each processor according to what slowed it."""
    left = [part * one.about["pace"]["left"] for one in every if one.load == load]
    return f"{Capacity(processors, part)}{f' (measured: {fmean(left):.3f})' if left else ''}"


def _code(every: Sequence[Record]) -> str:
    """The commit that ran; where there are several, with how many runs each has."""
    counts = Counter(str(one.about["code"]) for one in every)
    if len(counts) == 1:
        return f"Code: commit {next(iter(counts))}."
    shown = (f"{code} ({count} {'run' if count == 1 else 'runs'})" for code, count in sorted(counts.items()))
    return f"Code: commits {', '.join(shown)}."


def _static(evidence: Evidence) -> str:
    """Which divisions reach what context weights are asked for: where a static one does, contexts are not needed."""
    lines = []
    for goal in GOALS:
        if goal.metric == "critical hit rate" and goal.configuration in (WEIGHTS.name, WEIGHTS_GATED.name):
            gated = CONFIGURATIONS[goal.configuration].gated
            found = {one.title: _reaches(evidence, goal, one.name) for one in FACTORS if one.gated is gated}
            reach = [title for title, reached in found.items() if reached]
            none = (
                "none of those that were measured" if False in found.values() else "not measured, or in too few blocks"
            )
            lines.append(f"- {goal.name}: {', '.join(reach) or none}.\n")
    return "Which configurations reach the goals of the critical tasks (uncorrected):\n\n" + "".join(lines)


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
        yield "## From which load on contexts are needed: hit rates in the worst context, in percent\n"
        yield sweep
    chains = tables.chains(evidence, HEAVY, SHOWN)
    if chains:
        yield "## From the camera, and from a word, to the wheels; heavy load\n"
        yield chains
    totals = tables.totals(evidence)
    if totals:
        yield "## The paper's measure, under its terms: queues lose nothing, a run ends when they are empty\n"
        yield f"Total time of Linux default divided by each configuration's (the paper: up to {SPEEDUP}):\n"
        yield totals
    yield f"## Threats to validity\n\n{THREATS}"
    yield f"## Repeat it\n\n{REPEAT}"
    yield "[details.md](details.md): how every input ended, context onsets, accuracy, the player's own lateness.\n"


def _details(evidence: Evidence, found: Sequence[Verdict], figures: Path) -> Iterator[str]:
    yield "# Details of the experiments\n"
    if "loads" in evidence.frozen:
        yield "## What was calibrated, and then frozen\n"
        yield detail_tables.calibrated(evidence.frozen)
    yield tables.alone(evidence)
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


def _details_of_load(evidence: Evidence, load: str) -> Iterator[str]:
    yield f"## {load.capitalize()} load\n"
    if load not in (HEAVY, LIGHT):  # the report has these
        yield "### Hit rates in percent\n"
        yield tables.of_load(evidence, load)
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
