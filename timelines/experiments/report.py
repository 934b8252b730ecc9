"""Writes report.md, its figures and measures.json from the raw data in `<series>/<configuration>/<repeat>/`."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from timelines.demo.deploy import DeployError
from timelines.experiments import figures, goals, measures, tables
from timelines.experiments.configurations import BASELINE, CFS, RT, WEIGHT
from timelines.experiments.goals import CRITICAL
from timelines.experiments.intervals import of_ratios, spread
from timelines.experiments.series import read_series

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from timelines.experiments.raw_data import RunData
    from timelines.experiments.series import Series

BUSY = 0.75
"""Load for each core, of others, from which on a run says as much about them as about its configuration."""
INTRODUCTION = """\
# Experiments

Made by `make experiments`. Medians over the repeats, with least and greatest in brackets; ratios are geometric means
over pairs of runs of the same repeat, with the interval of 95 % confidence in brackets where there are two pairs or
more. The raw data of each run is in `build/experiments/<timeline>-x<pace>/<configuration>/<repeat>/`: `run.json` has
every input's stamp and the machine, `run.mcap` what each task did with it (`robot/<task>/runs`) and published, plans,
and the kernel's counters ten times a second; `profiles.json` what inputs cost. `measures.json` has each run's figures.

- *Pace*: at real pace inputs come at the story's pace; at six times the pace a robot has six times the work, what
  one with a sixth of this machine's speed would have.
- *Total time*: from the first input until every input that the policy did not suspend is done (paper VI-B). Queues
  drop nothing; inputs that were suspended or lost on the bus are counted apart. No scheduler ends before the last input
  comes, so where Linux default keeps up there is nothing to gain.
- *Speedup*: total time of Linux default divided by it, repeat by repeat. *On equal work*: the same until those inputs
  are done that both runs processed.
- *Missed*: inputs done later than their deadline, or never, of those that were not suspended.
- *Accuracy*: commands and signs count where the policy allowed the task to work.
"""
BY_SHARE = "they followed the share: with less CPU, slam looked for fewer features and signs looked at smaller pictures"
BY_NEED = "they followed need: a task that was late did less for each input"
FULL = "full throughout, so that an input costs the same under each configuration"
"""What the quality of the modules was; runs of before it was noted followed the share."""


def write_report(raw: Path, datasets: Path, out: Path) -> Path:
    """Write the report of all finished runs below `raw`; DeployError if there is none.

    `datasets` has the poses' ground truth.
    """
    every = read_series(raw, datasets)
    if not every:
        raise DeployError(f"{raw}: no finished run to report")
    (out / "figures").mkdir(parents=True, exist_ok=True)
    parts = [f"{INTRODUCTION}{_qualities(every)}", _machines(every), *_goals(every), *_speedups(every, out)]
    for series in every:
        parts += _series(series, out)
    path = out / "report.md"
    path.write_text("\n".join(parts), encoding="utf-8")
    figures_of_runs = [_measured(series, run) for series in every for run in series.each()]
    (out / "measures.json").write_text(json.dumps(figures_of_runs, indent=1), encoding="utf-8")
    return path


def _qualities(every: Sequence[Series]) -> str:
    words = {None: BY_SHARE, True: BY_NEED, False: FULL}
    found = {words[run.about.get("adaptive")] for series in every for run in series.each()}
    return "".join(f"- Quality of the modules: {word}.\n" for word in sorted(found))


def _machines(every: Sequence[Series]) -> str:
    runs = [run for series in every for run in series.each()]
    machines = {
        "{processor}, {cores} cores, {memory_gib} GiB, Linux {kernel}".format(**run.about["machine"]) for run in runs
    }
    dates = sorted(run.about["date"] for run in runs)
    return (
        f"Machine: {'; '.join(sorted(machines))}. {len(runs)} runs, {dates[0]} to {dates[-1]}. Load of the machine"
        f" before a run (one minute): {spread([run.about['load']['before'][0] for run in runs])}; it is of the pods'"
        " start, and of others.\n"
    )


def _goals(every: Sequence[Series]) -> Iterator[str]:
    for configuration in (CFS, WEIGHT, RT):
        found = list(goals.verdicts(every, configuration.name))
        if found:
            yield f"## Goals, {configuration.title}\n"
            yield tables.goal_table(found)


def _speedups(every: Sequence[Series], out: Path) -> Iterator[str]:
    """Figure 6 of the paper: all experiments beside each other."""
    bars = {
        series.title: {
            series.of(name)[0].title: of_ratios(found)
            for name in series.runs
            if name != BASELINE and (found := series.paired(name, goals.speedup))
        }
        for series in every
    }
    if any(bars.values()):
        figures.draw_speedups(bars, out / "figures" / "speedup.svg")
        yield "![Speedup in total time over Linux default](figures/speedup.svg)\n"


def _series(series: Series, out: Path) -> Iterator[str]:
    repeats = max(map(len, series.runs.values()))
    yield f"## {series.title}: {series.first.ended - series.first.started:.1f} s of inputs, {repeats} repeats\n"
    yield tables.overview(series)
    yield f"### {CRITICAL}, and what it answers in\n"
    yield tables.critical(series)
    yield "### How right each task was\n"
    yield tables.accuracies(series)
    yield "### Each task\n"
    yield tables.tasks(series)
    predicted = tables.predictions(series)
    if predicted:
        yield "### Predicted and measured\n"
        yield "By `contextpolicy simulate --profiles`, with the profiles that each run's tasks reported.\n"
        yield predicted
    yield from _doubts(series)
    yield from _pictures(series, out)


def _doubts(series: Series) -> Iterator[str]:
    """What makes a run less than it should be."""
    for run in series.each():
        if not run.drained:
            yield f"- {run.title}: queues were not empty when the run was given up; its total time is a lower bound.\n"
        load, cores = run.about["load"]["before"][0], run.about["machine"]["cores"]
        if load > BUSY * cores:
            yield f"- {run.title}: the machine had a load of {load:.1f} before the run.\n"
        for task, inputs in run.about["counted"].items():
            missing = sum(inputs.values()) - len(run.done.get(task, ()))
            if missing > 0:
                yield f"- {run.title}: {task} has done {missing} inputs that the recorder did not hear of: not lost.\n"


def _pictures(series: Series, out: Path) -> Iterator[str]:
    firsts = [series.of(name)[0] for name in series.runs]
    misses = {own[0].title: [goals.misses(run) for run in own] for own in map(series.of, series.runs)}
    title = f"{series.title}: deadlines that {CRITICAL} misses while the robot moves"
    yield _picture(
        out,
        f"{series.name}-misses",
        title,
        lambda path: figures.draw_misses(misses, path, task=CRITICAL, title=title),
    )
    times = {run.title: measures.responses(run, CRITICAL, moving=True) for run in firsts}
    answers = f"{series.title}: response times of {CRITICAL} while the robot moves"
    deadline = series.first.deadlines.get(CRITICAL)
    yield _picture(
        out,
        f"{series.name}-responses",
        answers,
        lambda path: figures.draw_responses(times, path, task=CRITICAL, title=answers, deadline=deadline),
    )
    for run in firsts:
        name, what = f"{series.name}-{run.configuration}", f"{series.title}, {run.title}"
        used = f"{what}: CPU that each task used over time"
        yield _picture(out, f"{name}-cpu", used, lambda path, run=run: figures.draw_run(run, path))
        if run.plans:
            decided = f"{what}: contexts, weights and shares over time"
            yield _picture(out, f"{name}-decisions", decided, lambda path, run=run: figures.draw_decisions(run, path))


def _picture(out: Path, name: str, what: str, draw: Any) -> str:
    draw(out / "figures" / f"{name}.svg")
    return f"![{what}](figures/{name}.svg)\n"


def _measured(series: Series, run: RunData) -> dict[str, Any]:
    """A run's figures, for programs."""
    return {
        "series": series.name,
        "configuration": run.configuration,
        "repeat": int(series.folders[run].name),
        "date": run.about["date"],
        "total_time": measures.total_time(run),
        "drained": run.drained,
        "reactions": measures.reactions(run),
        "tasks": {
            task: {
                "inputs": measures.counts(run, task),
                "done_after": measures.task_time(run, task),
                "moving": asdict(measures.response(run, task, moving=True)),
                "standing": asdict(measures.response(run, task, moving=False)),
                "cpu": measures.cpu_seconds(run, task),
                "accuracy": asdict(found) if (found := series.accuracies[run].get(task)) else None,
            }
            for task in run.inputs
        },
    }
