"""`python -m modules.slam.comparison FOLDER...`: compare SLAM with a baseline, on recorded sequences with ground truth.

Each FOLDER is a stereo sequence in EuRoC's layout or KITTI's, with its own calibration. Every picture is processed, one
after the other on one core, so what is measured is how exact the poses are and what CPU they take, not whether they
come in time; while they do, the module runs at quality 1. Prints a Markdown table: ATE after rigid alignment, drift of
the end as a part of the path when the first poses are laid on each other, the standard deviation that was published
of the end (in its worst direction) as such a part, how many pictures got a pose, how many of those were doubted, and
CPU time a picture.
"""

from __future__ import annotations

import argparse
import json
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from modules.slam import estimates
from modules.slam.evaluation import evaluate, quality
from modules.slam.trajectory import load
from modules.slam.trajectory_error import statistics
from robotkit import ConfigurationError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from modules.slam.estimates import Estimate

QUALITIES = (1.0, 0.5, 0.3)
HEAD = (
    "sequence",
    "method",
    "path",
    "ATE",
    "drift",
    "its deviation",
    "pictures with a pose",
    "doubted",
    "CPU a picture, mean / median",
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; exit code 2 for a folder that is no sequence with ground truth."""
    options = _parser().parse_args(arguments)
    try:
        rows = [row for folder in options.folders for row in rows_of(folder, options.qualities)]
    except ConfigurationError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    sys.stdout.write(json.dumps(rows, indent=2) + "\n" if options.output == "json" else as_table(rows))
    return 0


def rows_of(folder: Path, qualities: Sequence[float]) -> Iterator[dict[str, object]]:
    """The figures of each method on a sequence."""
    methods: dict[str, Callable[[Path], Estimate]] = {"baseline": estimates.run_baseline}
    methods |= {f"slam, quality {each:g}": partial(estimates.run, quality=each) for each in qualities}
    for name, run in methods.items():
        estimate = run(folder)
        try:
            found = figures(estimate, folder)
        except ConfigurationError as error:
            raise ConfigurationError(f"{folder.name}, {name}: {error}") from error
        yield {"sequence": folder.name, "method": name} | found


def figures(estimate: Estimate, folder: Path) -> dict[str, object]:
    """Metres, parts of 1, and milliseconds."""
    report = evaluate(estimate.trajectory, load(folder))
    path, deviation = report["path"], estimate.deviation
    times = statistics(np.array(estimate.cpu) * 1e3)
    return {
        "path": path,
        "ate": report["ate"]["rmse"],
        "drift": report["drift"],
        "deviation": deviation / path if deviation is not None and path else None,
        "coverage": len(estimate.poses) / estimate.frames,
        "degraded": estimate.degraded / max(len(estimate.poses), 1),
        "cpu_mean_ms": times["mean"],
        "cpu_median_ms": times["median"],
    }


def as_table(rows: Sequence[dict[str, object]]) -> str:
    """As Markdown."""
    template = (
        "| {sequence} | {method} | {path:.1f} m | {ate:.3f} m | {drift:.2%} | {said} | {coverage:.0%} | {degraded:.0%} "
        "| {cpu_mean_ms:.1f} / {cpu_median_ms:.1f} ms |\n"
    )
    head = f"| {' | '.join(HEAD)} |\n|{'---|' * len(HEAD)}\n"
    return head + "".join(template.format(**row, said=_percent(row["deviation"])) for row in rows)


def _percent(part: object) -> str:
    return "" if part is None else f"{part:.2%}"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m modules.slam.comparison",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER", help="folder of a EuRoC or KITTI sequence")
    parser.add_argument(
        "--qualities", type=quality, nargs="*", default=QUALITIES, help="how much SLAM does for a picture (1 0.5 0.3)"
    )
    parser.add_argument("--output", choices=("text", "json"), default="text", help="format of the figures")
    return parser


if __name__ == "__main__":
    sys.exit(main())
