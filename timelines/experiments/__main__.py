"""`python -m timelines.experiments exp1 exp2 exp3`: run what has not been run yet, then write the report."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import track

from contextpolicy.errors import ContextPolicyError
from contextpolicy.streams.timeline import load
from robotkit.euroc import DatasetError
from timelines.datasets.recordings import ROOT
from timelines.demo import deploy
from timelines.experiments import installation
from timelines.experiments.configurations import ALL
from timelines.experiments.report import write_report
from timelines.experiments.run import RUN, execute
from timelines.experiments.trials import EXPERIMENTS, longest, trials

if TYPE_CHECKING:
    from collections.abc import Sequence

    from timelines.experiments.trials import Trial

OUT = deploy.REPOSITORY / "build" / "experiments"
TIMELINES = deploy.REPOSITORY / "timelines"
console = Console() if sys.stdout.isatty() else Console(width=120)  # a pipe has no width, and 80 would cut lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Run and report; exit code 1 when a run fails: those that are finished are kept, and not run again."""
    parser = _parser()
    options = parser.parse_args(arguments)
    unknown = sorted(set(options.only) - {configuration.name for configuration in ALL})
    if unknown:
        parser.error(f"--only {' '.join(unknown)}: allowed are {', '.join(one.name for one in ALL)}")
    try:
        if not options.report_only:
            _run_all(_missing(options), options)
        console.print(
            f"report: {write_report(options.out, options.datasets, options.report or options.out)}", highlight=False
        )
    except (ContextPolicyError, DatasetError, deploy.DeployError) as error:
        console.print(f"[red]{error}[/]", highlight=False)
        return 1
    return 0


def _missing(options: argparse.Namespace) -> list[Trial]:
    """What is still to run."""
    every = trials(options.experiments, options.repeats, paces=options.paces, only=options.only, can=installation.can)
    return [trial for trial in every if not (trial.folder(options.out) / RUN).is_file()]


def _run_all(missing: list[Trial], options: argparse.Namespace) -> None:
    """Install once for all runs in a row that need the same; begin none that would not end in time."""
    ends = time.monotonic() + 60 * options.minutes
    took: list[float] = []
    installed: bool | None = None
    for number, trial in enumerate(track(missing, "runs", console=console, disable=not console.is_terminal)):
        timeline = TIMELINES / f"{trial.experiment}.json"
        begun = time.monotonic()
        if begun + longest(took, load(timeline).duration, trial.pace) > ends:
            console.print(f"{len(missing) - number} runs are left: the same command goes on with them", highlight=False)
            return
        console.print(f"[bold]{number + 1} of {len(missing)}[/] {trial}", highlight=False)
        if installed is not trial.configuration.agent:
            installation.install(trial.configuration)
            installed = trial.configuration.agent
        execute(trial, timeline, options.datasets, trial.folder(options.out), options.policy)
        took.append(time.monotonic() - begun)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m timelines.experiments", description=__doc__)
    parser.add_argument("experiments", nargs="+", choices=EXPERIMENTS, metavar="EXPERIMENT", help="exp1, exp2, exp3")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each configuration (%(default)s)")
    parser.add_argument("--only", nargs="+", default=(), metavar="CONFIGURATION", help="these configurations")
    parser.add_argument("--paces", nargs="+", type=float, default=(), metavar="PACE", help="1: real; 2: twice as fast")
    parser.add_argument(
        "--minutes", type=float, default=float("inf"), help="begin no run that would end later than that"
    )
    parser.add_argument(
        "--policy", type=Path, default=installation.POLICY, metavar="FILE", help="divide by this one instead"
    )
    parser.add_argument("--out", type=Path, default=OUT, metavar="DIR", help="raw data (build/experiments)")
    parser.add_argument("--datasets", type=Path, default=ROOT, metavar="DIR", help="recordings (%(default)s)")
    parser.add_argument("--report", type=Path, metavar="DIR", help="where the report goes (default: to the raw data)")
    parser.add_argument("--report-only", action="store_true", help="run nothing, write the report of what was run")
    return parser


if __name__ == "__main__":
    sys.exit(main())
