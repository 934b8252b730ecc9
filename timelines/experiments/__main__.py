"""`python -m timelines.experiments`: run what has not been run yet, then write the report.

Before the first block it calibrates the loads and searches static weights on the tuning stories, and freezes both. It
resumes where it was stopped. With any choice (stories, configurations, loads, blocks) it is a quick look: nothing is
calibrated for it, and its results go to a folder of their own.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from contextpolicy.errors import ContextPolicyError
from robotkit.euroc import DatasetError
from timelines.datasets.recordings import ROOT
from timelines.demo import deploy
from timelines.experiments.blocks import PLAN, trials
from timelines.experiments.campaign import Campaign, commit_folder
from timelines.experiments.configurations import CONFIGURATIONS
from timelines.experiments.evidence import BLOCKS, Evidence, read_frozen, write_frozen
from timelines.experiments.exclusive import exclusively
from timelines.experiments.prepare import OutOfTimeError, Preparation, name, settings, tuned_weights
from timelines.experiments.record import RecordError
from timelines.experiments.report import write_report
from timelines.experiments.stories import HELD_OUT, PAPER
from timelines.experiments.workbench import Folders, Workbench

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence


OUT = deploy.REPOSITORY / "build" / "experiments"
DATA = deploy.REPOSITORY / "timelines" / "results" / "data"
RUN = list(dict.fromkeys(part.load for part in PLAN))
REPORTED = [story.name for story in (*HELD_OUT, *PAPER)]
console = Console() if sys.stdout.isatty() else Console(width=120)  # a pipe has no width, and 80 would cut lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Run and report; exit code 1 when a run fails: those that are finished are kept, and not run again."""
    options = _parser().parse_args(arguments)
    quick = bool(options.stories or options.only or options.loads or options.blocks)
    raw = options.out / "quick" if quick else options.out
    folders = Folders(
        raw, options.data or (raw / "data" if quick else DATA), options.datasets, options.out / "timelines"
    )
    ran = options.report_only or _succeeds(lambda: _run_exclusively(options, folders, quick=quick))
    reported = _succeeds(lambda: _report(folders.data, options.report or raw, needed=options.report_only))
    return 0 if ran and reported else 1


def _succeeds(step: Callable[[], bool]) -> bool:
    """Do a step, and say why it failed."""
    try:
        return step()
    except (ContextPolicyError, DatasetError, deploy.DeployError, RecordError) as error:
        console.print(str(error), style="red", highlight=False, markup=False)
        return False


def _report(data: Path, out: Path, *, needed: bool) -> bool:
    """Write the report, also where runs have failed: what was measured before is worth reading.

    RecordError if there are no runs and it is `needed`.
    """
    evidence = Evidence.read(data)
    if needed and not evidence.runs:
        raise RecordError(f"{data}: no runs: expected blocks of runs below {data / BLOCKS}")
    if evidence.runs:
        Lines().say(f"report: {write_report(evidence, out)}")
    return True


def _run_exclusively(options: argparse.Namespace, folders: Folders, *, quick: bool) -> bool:
    with exclusively():
        return _run(options, Workbench(folders), quick=quick)


def _run(options: argparse.Namespace, bench: Workbench, *, quick: bool) -> bool:
    """Run what is missing; False if a configuration had to be given up."""
    data, until = bench.folders.data, _until(options.minutes)
    frozen = dict(read_frozen(DATA if quick else data))
    chosen = list(trials(stories=options.stories, only=options.only, loads=options.loads, most=options.blocks))
    try:
        preparation = Preparation(bench, Lines(), until)
        if not quick:
            _prepare(preparation, frozen, data, lambda what: _frozen(data, what, options))
        elif frozen:
            write_frozen(data, frozen)
        campaign = Campaign(bench, settings(frozen), tuned_weights(frozen), Lines())
        if not quick and campaign.missing(chosen):
            preparation.measured(frozen)
    except OutOfTimeError:
        Lines().say("not all is prepared: the same command goes on with it")
        return True
    left = campaign.run(chosen, until=until, commit=options.commit)
    if left:
        Lines().say(f"{left} runs are left: run the same command again to continue")
    return not campaign.failed


def _prepare(preparation: Preparation, frozen: dict[str, Any], data: Path, kept: Callable[[str], None]) -> None:
    """Find out what is missing, and keep each finding at once; `kept` is called with its name."""
    if "loads" not in frozen:
        frozen |= preparation.calibrated()
        write_frozen(data, frozen)
        kept("loads and deadlines")
    for gated in (False, True):
        tuned = frozen.setdefault("tuned", {})
        if name(gated=gated) not in tuned:
            tuned[name(gated=gated)] = preparation.tuned(frozen, gated=gated)
            write_frozen(data, frozen)
            kept(f"static weights, {name(gated=gated)}")
    if "predicted" not in frozen:
        frozen["predicted"] = preparation.predicted(frozen)
        write_frozen(data, frozen)
        kept("predictions")


def _frozen(data: Path, what: str, options: argparse.Namespace) -> None:
    """Commit a finding, which takes half an hour to find out again."""
    failed = commit_folder(data, f"Freeze {what} of the experiments") if options.commit else ""
    if failed:
        Lines().say(failed)


def _until(minutes: float) -> Callable[[float], bool]:
    """Whether there is still time for something that takes so many seconds."""
    ends = time.monotonic() + 60 * minutes
    return lambda seconds: time.monotonic() + seconds <= ends


class Lines:
    """Progress on the console."""

    def say(self, line: str) -> None:
        """Print a line as it is."""
        console.print(line, highlight=False, markup=False)


def _story(text: str) -> str:
    """One of those that are reported; argparse's own `choices` would refuse that none is given."""
    if text not in REPORTED:
        raise argparse.ArgumentTypeError(f"invalid value {text!r}: expected one of {', '.join(REPORTED)}")
    return text


def _count(text: str) -> int:
    """At least one."""
    if not text.isdecimal() or not int(text):
        raise argparse.ArgumentTypeError(f"invalid value {text!r}: expected a whole number of at least 1")
    return int(text)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m timelines.experiments",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("stories", nargs="*", type=_story, metavar="STORY", help=", ".join(REPORTED))
    parser.add_argument("--blocks", type=_count, metavar="N", help="how many blocks of each part to run at most")
    parser.add_argument("--loads", nargs="+", default=(), choices=RUN, metavar="LOAD", help=", ".join(RUN))
    parser.add_argument(
        "--only",
        nargs="+",
        default=(),
        choices=list(CONFIGURATIONS),
        metavar="CONFIGURATION",
        help=", ".join(CONFIGURATIONS),
    )
    parser.add_argument(
        "--minutes", type=float, default=float("inf"), help="begin no block that would end after so many minutes"
    )
    parser.add_argument("--commit", action="store_true", help="commit the data of each block when it ends")
    parser.add_argument(
        "--out", type=Path, default=OUT, metavar="DIR", help="folder of the runs' recordings (build/experiments)"
    )
    parser.add_argument(
        "--data", type=Path, metavar="DIR", help="folder of the committed data (timelines/results/data)"
    )
    parser.add_argument(
        "--datasets", type=Path, default=ROOT, metavar="DIR", help="folder of the data sets (%(default)s)"
    )
    parser.add_argument(
        "--report", type=Path, metavar="DIR", help="folder of the report (default: that of the recordings)"
    )
    parser.add_argument("--report-only", action="store_true", help="run nothing: compute every figure from the data")
    return parser


if __name__ == "__main__":
    sys.exit(main())
