"""From the start of a robot's node to its first plan: how long a robot that was switched on has no policy.

    python -m tests.bench.boot [--rounds 3]

Builds and starts the node if need be; needs the image contextpolicy:dev on it. Each round ends all of Kubernetes and
every container, keeps what is on the disk, and starts it again; a kernel that boots and its init are not in these
times. Prints a table, writes build/bench/boot.json.
"""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import argparse
import json
import sys
import time
from datetime import datetime
from statistics import median
from typing import Any

from tests.bench.engine_measure import machine
from tests.bench.results import keep
from tests.e2e.cluster import until
from tests.e2e.rebooted import PLANNED, ROBOT, SYSTEM, governed, kubectl, limits
from tests.node import lifecycle

PATIENCE = 180.0
OPERATOR = "app.kubernetes.io/component=operator"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3, help="(%(default)s)")
    options = parser.parse_args()
    with governed():
        rounds = [_reboot() for _ in range(options.rounds)]
    result = {"rounds": rounds, "machine": machine()}
    keep("boot", result)
    print(result["machine"])
    for stage in rounds[0]:
        seconds = [one[stage] for one in rounds]
        print(f"{stage:42}{median(seconds):6.1f} s   ({', '.join(f'{value:.1f}' for value in seconds)})")
    return 0


def _reboot() -> dict[str, float]:
    """Seconds from the node's start to each stage."""
    lifecycle.down(keep_state=True)
    began = time.time()
    lifecycle.up()
    ready = time.time()
    until("the first plan is published", lambda: _plan()["run"] / 1e3 > began, PATIENCE)
    until("its limits are in force", lambda: limits() == PLANNED or limits(), PATIENCE)
    stages = {
        "the node is Ready": ready,
        "the operator's container started": _started(),
        "its first plan": _moment(_plan()["time"]),
        "the limits are in force, reported by the API": time.time(),
    }
    return {stage: round(at - began, 1) for stage, at in stages.items()}


def _plan() -> dict[str, Any]:
    """The plan of the policy's status."""
    found: dict[str, Any] = json.loads(kubectl("get", "ctxp", "robot", "-n", ROBOT, "-o", "json"))["status"]["plan"]
    return found


def _started() -> float:
    """When the operator's container was last started."""
    [pod] = json.loads(kubectl("get", "pods", "-n", SYSTEM, "-l", OPERATOR, "-o", "json"))["items"]
    return _moment(pod["status"]["containerStatuses"][0]["state"]["running"]["startedAt"])


def _moment(text: str) -> float:
    return datetime.fromisoformat(text).timestamp()


if __name__ == "__main__":
    sys.exit(main())
