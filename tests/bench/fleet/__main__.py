"""What a fleet costs the operator: 5,000 pods, 500 of them tasks of 50 policies, on a real API server without kubelets.

    python -m tests.bench.fleet [--pods 5000] [--robots 50] [--tasks 10]

Prints a table, writes build/bench/fleet.json; progress goes to stderr. Memory and CPU are those of the operator's own
process, CPU in seconds of its own, so that a busy machine does not count; times of reactions do suffer from one. Nobody
puts the accepted limits in force, so all patches of a plan go out at once (transition Prompt).
"""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import argparse
import sys
from dataclasses import asdict, fields
from typing import Any

from tests.bench.engine_measure import machine
from tests.bench.fleet.crowd import Fleet
from tests.bench.fleet.run import started
from tests.bench.results import keep


def main() -> int:
    options = _options()
    fleet = Fleet(options.robots, options.tasks, options.replicas, options.pods)
    with started(fleet) as run:
        phases = (run.start, run.govern, run.react, run.storm, run.churn, run.rest)
        result: dict[str, Any] = {name: value for phase in phases for name, value in phase().items()}
    result |= {"fleet": asdict(fleet), "machine": machine()}
    keep("fleet", result)
    for name, value in result.items():
        print(f"{name:45} {value}")
    return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench.fleet", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for size in fields(Fleet):
        parser.add_argument(f"--{size.name}", type=int, default=size.default, help="(%(default)s)")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
