"""Writes report.md and its figures from the raw data below a folder: `<experiment>/<configuration>/<repeat>/`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from timelines.demo.deploy import DeployError
from timelines.experiments import figures, installation, measures
from timelines.experiments.configurations import ALL, BASELINE, EXPERIMENTS
from timelines.experiments.measures import Fate
from timelines.experiments.raw_data import read_run
from timelines.experiments.run import RUN

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from timelines.experiments.measures import Response
    from timelines.experiments.raw_data import RunData

    Runs = dict[str, dict[int, RunData]]

CRITICAL = "slam"
"""The task whose deadlines count while the robot moves (paper VI-A)."""
NONE = "-"
INTRODUCTION = """\
# Experiments

Made by `make experiments`. Medians over the repeats, with least and greatest in brackets; the raw data of each run is
in `<experiment>/<configuration>/<repeat>/` beside this file: `run.json` has every input's stamp and the machine,
`run.mcap` what each task did with it (`robot/<task>/runs`), the plans, and the kernel's counters ten times a second.

- *Total time*: from the first input until every input that the policy did not suspend is done (paper VI-B). Queues
  drop nothing; inputs that were suspended or lost on the bus are counted apart.
- *Speedup*: total time of Linux default divided by it, repeat by repeat. *On equal work*: the same until those inputs
  are done that both runs processed.
- *Missed*: inputs done later than their deadline, or never, of those that were not suspended.
- Modules adapt to their share: with less CPU, slam looks for fewer features and signs looks at smaller pictures.
- The VerticalPodAutoscaler is left out: the node does not have it. Accuracy is not judged here yet.
"""


def write_report(out: Path) -> Path:
    """Write the report of all finished runs; DeployError if there is none."""
    experiments = {name: found for name in EXPERIMENTS if (found := _runs(out / name))}
    if not experiments:
        raise DeployError(f"{out}: no finished run to report")
    parts = [INTRODUCTION, _machines(experiments.values())]
    for name, runs in experiments.items():
        parts += _experiment(name, runs, out)
    path = out / "report.md"
    path.write_text("\n".join(parts), encoding="utf-8")
    return path


def _runs(folder: Path) -> Runs:
    """By configuration and repeat, in the order of the configurations."""
    found = {
        one.name: {int(path.parent.name): read_run(path.parent) for path in sorted(folder.glob(f"{one.name}/*/{RUN}"))}
        for one in ALL
    }
    return {name: repeats for name, repeats in found.items() if repeats}


def _machines(experiments: Iterable[Runs]) -> str:
    all_runs = [run for runs in experiments for run in _each(runs)]
    machines = {
        "{processor}, {cores} cores, {memory_gib} GiB, Linux {kernel}".format(**run.about["machine"])
        for run in all_runs
    }
    loads = measures.middle([run.about["load"]["before"][0] for run in all_runs])
    dates = sorted(run.about["date"] for run in all_runs)
    return (
        f"Machine: {'; '.join(sorted(machines))}. {len(all_runs)} runs, {dates[0]} to {dates[-1]}. Load of the"
        f" machine before a run (one minute): {_spread(loads)}; what is above 0 is not the robot's.\n"
    )


def _each(runs: Runs) -> Iterator[RunData]:
    for repeats in runs.values():
        yield from repeats.values()


def _experiment(name: str, runs: Runs, out: Path) -> Iterator[str]:
    first = next(_each(runs))
    yield f"## {name}: {first.ended - first.started:.1f} s of inputs, {max(map(len, runs.values()))} repeats\n"
    yield _overview(runs)
    yield f"### {CRITICAL}, and what it answers in\n"
    yield _responses(runs, CRITICAL)
    yield "### Each task\n"
    yield _tasks(runs)
    yield from _doubts(runs)
    yield from _pictures(name, runs, out)


def _overview(runs: Runs) -> str:
    rows = []
    for repeats in runs.values():
        own = list(repeats.values())
        fates = [measures.counts(run, task) for run in own for task in run.inputs]
        each = {fate: sum(count[fate] for count in fates) / len(own) for fate in Fate}
        times = [moment * 1000 for run in own for moment in measures.reactions(run)]
        rows.append(
            [
                own[0].title,
                _over(own, measures.total_time, "s"),
                _paired(runs, repeats, _speedup),
                _paired(runs, repeats, _on_equal_work),
                *(f"{each[fate]:.0f}" for fate in Fate),
                f"{measures.middle(times)[0]:.0f} ms ({len(times)})" if times else NONE,
                *(_over(own, _cpu_of(name), "s") for name in installation.CONTROL),
            ]
        )
    head = ["", "total time", "speedup", "on equal work", *(f"inputs {fate}" for fate in Fate), "sample to cgroup"]
    head += [f"CPU of the {name}" for name in installation.CONTROL]
    return _table(head, rows)


def _cpu_of(container: str) -> Callable[[RunData], float]:
    return lambda run: measures.cpu_seconds(run, container)


def _speedup(baseline: RunData, run: RunData) -> float:
    return measures.total_time(baseline) / measures.total_time(run)


def _on_equal_work(baseline: RunData, run: RunData) -> float:
    before, after = measures.equal_work(baseline, run)
    return before / after if after else 1.0


def _paired(runs: Runs, repeats: dict[int, RunData], compare: Callable[[RunData, RunData], float]) -> str:
    values = paired(runs, repeats, compare)
    return f"{_spread(measures.middle(values))} x" if values else NONE


def paired(runs: Runs, repeats: dict[int, RunData], compare: Callable[[RunData, RunData], float]) -> list[float]:
    """Compare each run with the baseline's of the same repeat, which ran just before."""
    baseline = runs.get(BASELINE, {})
    return [compare(baseline[repeat], run) for repeat, run in repeats.items() if repeat in baseline]


def _responses(runs: Runs, task: str) -> str:
    rows = []
    for repeats in runs.values():
        own = list(repeats.values())
        cells = [own[0].title]
        for moving in (True, False):
            found = [measures.response(run, task, moving=moving) for run in own]
            cells += _response(found)
        rows.append(cells)
    states = [f"{what}, robot {state}" for state in ("moves", "stands") for what in ("p50", "p99", "missed", "due")]
    return _table(["", *states], rows)


def _response(found: Sequence[Response]) -> list[str]:
    medians = [one.p50 * 1000 for one in found if one.p50 is not None]
    tails = [one.p99 * 1000 for one in found if one.p99 is not None]
    missed = measures.middle([one.misses * 100 for one in found])
    return [
        f"{_spread(measures.middle(medians))} ms" if medians else NONE,
        f"{_spread(measures.middle(tails))} ms" if tails else NONE,
        f"{_spread(missed)} %",
        f"{measures.middle([one.due for one in found])[0]:.0f}",
    ]


def _tasks(runs: Runs) -> str:
    rows = []
    for task in next(_each(runs)).inputs:
        for repeats in runs.values():
            own = list(repeats.values())
            fates = [measures.counts(run, task) for run in own]
            p50, p99, missed, _ = _response([measures.response(run, task) for run in own])
            counts = [f"{measures.middle([count[fate] for count in fates])[0]:.0f}" for fate in Fate]
            cpu = _over(own, _cpu_of(task), "s")
            rows.append([task, own[0].title, *counts, p50, p99, missed, cpu])
    return _table(["task", "", *Fate, "p50", "p99", "missed", "CPU"], rows)


def _doubts(runs: Runs) -> Iterator[str]:
    """What makes a run less than it should be."""
    for run in _each(runs):
        if not run.drained:
            yield f"- {run.title}: queues were not empty when the run was given up; its total time is a lower bound.\n"
        for task, inputs in run.about["counted"].items():
            missing = sum(inputs.values()) - len(run.done.get(task, ()))
            if missing:
                yield f"- {run.title}: {task} has done {missing} inputs that the recorder did not hear of: not lost.\n"


def _pictures(name: str, runs: Runs, out: Path) -> Iterator[str]:
    folder = out / "figures"
    folder.mkdir(exist_ok=True)
    titles = {config: next(iter(repeats.values())).title for config, repeats in runs.items()}
    speedups = {titles[config]: paired(runs, repeats, _speedup) for config, repeats in runs.items()}
    speedups = {title: values for title, values in speedups.items() if values}
    if speedups:
        spread = {title: measures.middle(values) for title, values in speedups.items()}
        figures.draw_bars(
            spread, folder / f"{name}-speedup.svg", title=f"{name}: speedup in total time", unit="x", mark=1
        )
        yield f"![Speedup](figures/{name}-speedup.svg)\n"
    misses = {
        titles[config]: measures.middle(
            [measures.response(run, CRITICAL, moving=True).misses * 100 for run in repeats.values()]
        )
        for config, repeats in runs.items()
    }
    title = f"{name}: deadlines that {CRITICAL} misses while the robot moves"
    figures.draw_bars(misses, folder / f"{name}-misses.svg", title=title, unit="% of the inputs that were due")
    yield f"![Misses](figures/{name}-misses.svg)\n"
    for config, repeats in runs.items():
        run = next(iter(repeats.values()))
        figures.draw_run(run, folder / f"{name}-{config}-cpu.svg")
        yield f"![CPU used]({folder.name}/{name}-{config}-cpu.svg)\n"
        if run.plans:
            figures.draw_decisions(run, folder / f"{name}-{config}-decisions.svg")
            yield f"![Weights and shares]({folder.name}/{name}-{config}-decisions.svg)\n"


def _over(runs: Sequence[RunData], measure: Callable[[RunData], float], unit: str) -> str:
    return f"{_spread(measures.middle([measure(run) for run in runs]))} {unit}"


def _spread(values: tuple[float, float, float]) -> str:
    middle, least, greatest = map(_number, values)
    return middle if least == greatest else f"{middle} [{least}, {greatest}]"


def _number(value: float) -> str:
    """Three digits, and never an exponent."""
    return f"{value:.0f}" if value >= 1000 else f"{value:.3g}"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [list(head), ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
