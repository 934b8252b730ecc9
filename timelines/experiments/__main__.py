"""`python -m timelines.experiments exp1 exp2 exp3`: run what has not been run yet, then write the report."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from contextpolicy.errors import ContextPolicyError
from robotkit.euroc import DatasetError
from timelines.datasets.recordings import ROOT
from timelines.demo import deploy
from timelines.experiments import installation
from timelines.experiments.configurations import ALL, EXPERIMENTS
from timelines.experiments.report import write_report
from timelines.experiments.run import RUN, execute

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from timelines.experiments.configurations import Configuration

OUT = deploy.REPOSITORY / "build" / "experiments"
TIMELINES = deploy.REPOSITORY / "timelines"
console = Console()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run and report; exit code 1 when a run fails: those that are finished are kept, and not run again."""
    parser = _parser()
    options = parser.parse_args(arguments)
    unknown = sorted(set(options.only) - {configuration.name for configuration in ALL})
    if unknown:
        parser.error(f"--only {' '.join(unknown)}: allowed are {', '.join(one.name for one in ALL)}")
    try:
        if not options.report_only:
            _run_all(list(_missing(options)))
        console.print(f"report: {write_report(options.out)}", highlight=False)
    except (ContextPolicyError, DatasetError, deploy.DeployError) as error:
        console.print(f"[red]{error}[/]")
        return 1
    return 0


def _missing(options: argparse.Namespace) -> Iterator[tuple[str, Configuration, Path, Path]]:
    """What is still to run: repeats are interleaved, so that a change of the machine meets all configurations alike."""
    for experiment in options.experiments:
        for repeat in range(options.repeats):
            for configuration in _wanted(experiment, options.only):
                folder = options.out / experiment / configuration.name / str(repeat)
                if not (folder / RUN).is_file():
                    yield f"{experiment} {configuration.title} {repeat}", configuration, folder, options.datasets


def _wanted(experiment: str, only: Sequence[str]) -> list[Configuration]:
    chosen = [one for one in EXPERIMENTS[experiment] if not only or one.name in only]
    return [one for one in chosen if not one.agent or installation.can_do_realtime()]


def _run_all(runs: list[tuple[str, Configuration, Path, Path]]) -> None:
    """Install once for all runs in a row that need the same."""
    installed: bool | None = None
    for number, (label, configuration, folder, datasets) in enumerate(runs, start=1):
        console.print(f"[bold]{number} of {len(runs)}[/] {label}", highlight=False)
        if installed is not configuration.agent:
            installation.install(configuration)
            installed = configuration.agent
        execute(configuration, TIMELINES / f"{folder.parents[1].name}.json", datasets, folder)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m timelines.experiments", description=__doc__)
    parser.add_argument("experiments", nargs="+", choices=EXPERIMENTS, metavar="EXPERIMENT", help="exp1, exp2, exp3")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each configuration (%(default)s)")
    parser.add_argument("--only", nargs="+", default=(), metavar="CONFIGURATION", help="these configurations")
    parser.add_argument("--out", type=Path, default=OUT, metavar="DIR", help="raw data and report (build/experiments)")
    parser.add_argument("--datasets", type=Path, default=ROOT, metavar="DIR", help="recordings (%(default)s)")
    parser.add_argument("--report-only", action="store_true", help="run nothing, write the report of what was run")
    return parser


if __name__ == "__main__":
    sys.exit(main())
