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
    from collections.abc import Callable, Sequence

    from modules.slam.estimates import Estimate
    from modules.slam.trajectory import Trajectory

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
    """Print the table of all that could be measured; exit code 2, and a line for each, if something could not."""
    options = _parser().parse_args(arguments)
    rows: list[dict[str, object]] = []
    problems: list[str] = []
    for folder in options.folders:
        try:
            rows += rows_of(folder, options.qualities, problems)
        except ConfigurationError as error:
            problems.append(str(error))
    sys.stderr.writelines(f"{problem}\n" for problem in problems)
    if rows:
        sys.stdout.write(json.dumps(rows, indent=2) + "\n" if options.output == "json" else as_table(rows))
    return 2 if problems else 0


def rows_of(folder: Path, qualities: Sequence[float], problems: list[str]) -> list[dict[str, object]]:
    """The figures of each method on a sequence; a method whose poses can't be measured is added to the problems."""
    methods: dict[str, Callable[[Path], Estimate]] = {"baseline": estimates.run_baseline}
    methods |= {f"slam, quality {each:g}": partial(estimates.run, quality=each) for each in qualities}
    truth, rows = load(folder), []
    for name, run in methods.items():
        estimate = run(folder)
        try:
            rows.append({"sequence": folder.name, "method": name} | figures(estimate, truth))
        except ConfigurationError as error:
            problems.append(f"{folder.name}, {name}: {error}")
    return rows


def figures(estimate: Estimate, truth: Trajectory) -> dict[str, object]:
    """Metres, parts of 1, and milliseconds."""
    report = evaluate(estimate.trajectory, truth)
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
