"""`python -m modules.slam.evaluation TRUTH [POSES]`: measure the accuracy of poses, with the same figures as evo.

TRUTH is the folder of a sequence in the layout of EuRoC or KITTI, or a TUM file. The poses are those of a TUM file, of
the module that runs on the robot's bus (--live), or of SLAM over the sequence's pictures, run here (--run).
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from modules.slam import estimates
from modules.slam.estimates import Estimate
from modules.slam.trajectory import TrajectoryError, associate, load, save
from modules.slam.trajectory_error import absolute_errors, end_drift, path_length, relative_errors, statistics
from robotkit import ConfigurationError
from robotkit.session import credentials, endpoints, open_session
from robotkit.termination import stop_on_signals

if TYPE_CHECKING:
    from collections.abc import Sequence

    from modules.slam.trajectory import Trajectory
    from modules.slam.trajectory_error import Unit


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the figures; exit code 2 when the trajectories can't be compared."""
    options = _parser().parse_args(arguments)
    try:
        truth = load(options.truth)
        estimate = _estimate(options)
        poses = load(options.poses) if options.poses else estimate.trajectory
        if options.save:
            save(options.save, poses)
        report = evaluate(poses, truth, options.delta, options.unit) | _costs(estimate)
    except ConfigurationError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    sys.stdout.write(json.dumps(report, indent=2) + "\n" if options.output == "json" else _as_text(report))
    return 0


def evaluate(poses: Trajectory, truth: Trajectory, delta: float = 1, unit: Unit = "frames") -> dict[str, Any]:
    """ATE in metres, RPE in metres and degrees per delta, the end's drift in metres and as a part of the path."""
    estimated, true = associate(poses, truth)
    if len(estimated) < 3:
        near = f"{len(estimated)} of {len(poses)} poses are within 0.01 s of the ground truth"
        raise TrajectoryError(f"{near}: expected at least 3")
    shifts, turns = relative_errors(estimated, true, delta, unit)
    if not len(shifts):
        raise TrajectoryError(f"no two poses are {delta:g} {unit} apart: choose a smaller --delta")
    path, drift = path_length(true), end_drift(estimated, true)
    return {
        "poses": len(poses),
        "compared": len(estimated),
        "path": path,
        "ate": statistics(absolute_errors(estimated, true)),
        "rpe": {"delta": delta, "unit": unit, "metres": statistics(shifts), "degrees": statistics(turns)},
        "end_drift": drift,
        "drift": drift / path if path else float("nan"),
    }


def quality(text: str) -> float:
    """Read an option: the quality that robotkit sets, above 0 and at most 1."""
    value = float(text)
    if not 0 < value <= 1:
        raise argparse.ArgumentTypeError(f"invalid value {text!r}: expected a number above 0 and at most 1")
    return value


def _estimate(options: argparse.Namespace) -> Estimate:
    if options.poses:
        return Estimate()
    if options.run:
        return estimates.run(options.truth, quality=options.quality, loops=not options.odometry)
    stop = stop_on_signals()
    with open_session(endpoints({"ZENOH_CONNECT": options.connect}), stop, secret=credentials(os.environ)) as session:
        return Estimate() if session is None else estimates.listen(session, options.key, stop, options.seconds)


def _costs(estimate: Estimate) -> dict[str, object]:
    """What the frames cost and how many have no pose; nothing is known of a file."""
    if not estimate.cpu:
        return {}
    return {
        "degraded": estimate.degraded,
        "lost": estimate.lost,
        "adrift": estimate.adrift,
        "broken": estimate.broken,
        "dropped": estimate.dropped,
        "cpu_ms": {name: round(value * 1e3, 1) for name, value in statistics(np.array(estimate.cpu)).items()},
    }


def _as_text(report: dict[str, object]) -> str:
    flat = {
        f"{name}.{part}" if part else name: value
        for name, values in report.items()
        for part, value in (values.items() if isinstance(values, dict) else [("", values)])
    }
    return "".join(f"{name}: {_figure(value)}\n" for name, value in flat.items())


def _figure(value: object) -> str:
    if isinstance(value, dict):
        return "  ".join(f"{name} {_figure(part)}" for name, part in value.items())
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m modules.slam.evaluation",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("truth", type=Path, help="folder of a EuRoC or KITTI sequence, or TUM file")
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("poses", type=Path, nargs="?", help="TUM file")
    source.add_argument("--live", action="store_true", help="listen on the bus until SIGINT or for --seconds")
    source.add_argument("--run", action="store_true", help="run over the sequence's pictures")
    live = parser.add_argument_group("with --live")
    live.add_argument("--connect", default=os.environ.get("ZENOH_CONNECT", ""), help="router ($ZENOH_CONNECT)")
    live.add_argument("--key", default=estimates.POSE_KEY, help="where the module publishes (%(default)s)")
    live.add_argument("--seconds", type=float, help="how long to listen")
    run = parser.add_argument_group("with --run")
    run.add_argument(
        "--quality", type=quality, default=1.0, help="how much to do for a picture, up to 1: all (%(default)g)"
    )
    run.add_argument("--odometry", action="store_true", help="close no loops")
    parser.add_argument("--delta", type=float, default=1, help="distance of RPE's pairs (%(default)s)")
    parser.add_argument("--unit", choices=("frames", "metres"), default="frames", help="unit of --delta (%(default)s)")
    parser.add_argument("--save", type=Path, metavar="FILE", help="write the poses as a TUM file")
    parser.add_argument("--output", choices=("text", "json"), default="text", help="format of the figures")
    return parser


if __name__ == "__main__":
    sys.exit(main())
