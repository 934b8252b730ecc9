"""What a fleet costs the operator: 5,000 pods, 500 of them tasks of 50 policies, on a real API server without kubelets.

    python -m tests.bench.fleet [--tree DIR] [--pods 5000] [--robots 50] [--tasks 10]

Prints a table, writes build/bench/fleet.json; progress goes to stderr. Memory and CPU are those of the operator's own
process, CPU in seconds of its own, so that a busy machine does not count; times of reactions do suffer from one. Nobody
puts the accepted limits in force, so all patches of a plan go out at once (transition Prompt). `--tree` measures the
operator of another checkout, side by side.
"""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import asdict, fields
from pathlib import Path
from statistics import median, quantiles
from typing import TYPE_CHECKING

from contextpolicy.bus.session import open_router
from tests.bench.engine_measure import machine
from tests.bench.fleet.control_plane import ControlPlane, free_port
from tests.bench.fleet.crowd import Fleet
from tests.bench.fleet.measured_operator import Applied, MeasuredOperator
from tests.e2e.cluster import REPOSITORY

if TYPE_CHECKING:
    import zenoh

OUTPUT = REPOSITORY / "build" / "bench" / "fleet.json"
QUIET = 20.0
"""Seconds for which an idle operator is watched."""
ROUNDS = 60
PAUSE = 0.4
"""Seconds between two rounds: a newer plan waits 0.3 s for the last resize of a pod."""
CHURN = 1000
SETTLE = 3.0
"""Seconds in which statuses and messages of what was done are written."""


def main() -> int:
    options = _options()
    fleet = Fleet(options.robots, options.tasks, options.pods)
    router = f"tcp/127.0.0.1:{free_port()}"
    with ControlPlane() as plane, open_router([router]) as bus:
        _say(f"creating {fleet.pods} pods")
        fleet.fill(plane)
        with MeasuredOperator(options.tree, plane.kubeconfig, router) as operator:
            result = Run(fleet, plane, bus, operator).measure()
    result |= {"fleet": asdict(fleet), "machine": machine()}
    OUTPUT.parent.mkdir(parents=True, exist_ok=True)
    OUTPUT.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    for name, value in result.items():
        print(f"{name:45} {value}")
    return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench.fleet", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--tree", type=Path, default=REPOSITORY, help="checkout whose operator runs (this one)")
    for size in fields(Fleet):
        parser.add_argument(f"--{size.name}", type=int, default=size.default, help="(%(default)s)")
    return parser.parse_args()


class Run:
    """The phases of a measurement, in their order."""

    def __init__(self, fleet: Fleet, plane: ControlPlane, bus: zenoh.Session, operator: MeasuredOperator) -> None:
        self._fleet, self._plane, self._bus, self._operator = fleet, plane, bus, operator
        self._applied = Applied(bus)
        self._turns = {fleet.namespace(robot): False for robot in range(fleet.robots)}

    def measure(self) -> dict[str, object]:
        phases = (self._start, self._govern, self._react, self._storm, self._churn, self._rest)
        return {name: value for phase in phases for name, value in phase().items()}

    def _start(self) -> dict[str, object]:
        _say("the operator starts")
        listed = self._operator.wait_until_serving()
        cpu, peak = self._operator.cpu(), self._operator.peak()
        return {"listed_after_s": round(listed, 2), "listed_cpu_s": round(cpu, 2), "listed_peak_mib": round(peak, 1)}

    def _govern(self) -> dict[str, object]:
        _say("policies come")
        before, began = self._operator.cpu(), time.monotonic()
        self._fleet.govern(self._plane)
        self._turn_all()
        self._applied.wait(self._fleet.robots * self._fleet.tasks)
        took = time.monotonic() - began
        time.sleep(SETTLE)
        return {"governed_after_s": round(took, 2), "governed_cpu_s": round(self._operator.cpu() - before, 2)}

    def _react(self) -> dict[str, object]:
        _say("one policy at a time")
        first, last = [], []
        for number in range(ROUNDS):
            self._next = self._fleet.namespace(number * 7 % self._fleet.robots)
            moments = self._applied.after(self._turn_next, self._fleet.tasks)
            first.append(moments[0])
            last.append(moments[-1])
            time.sleep(PAUSE)
        return {
            "first_patch_accepted_ms": round(median(first) * 1e3, 1),
            "first_patch_accepted_p90_ms": round(quantiles(first, n=10)[-1] * 1e3, 1),
            "all_patches_accepted_ms": round(median(last) * 1e3, 1),
        }

    def _storm(self) -> dict[str, object]:
        _say("all policies at once")
        before = self._operator.cpu()
        moments = self._applied.after(self._turn_all, self._fleet.robots * self._fleet.tasks)
        time.sleep(SETTLE)
        return {
            "storm_first_accepted_ms": round(moments[0] * 1e3, 1),
            "storm_all_accepted_ms": round(moments[-1] * 1e3, 1),
            "storm_cpu_s": round(self._operator.cpu() - before, 2),
        }

    def _churn(self) -> dict[str, object]:
        _say("others' pods change")
        before = self._operator.cpu()
        for number in range(CHURN):
            self._fleet.disturb(self._plane, number)
        time.sleep(SETTLE)
        return {"cpu_us_per_foreign_pod_event": round((self._operator.cpu() - before) / CHURN * 1e6)}

    def _rest(self) -> dict[str, object]:
        _say("nothing happens")
        before = self._operator.cpu()
        time.sleep(QUIET)
        idle = 100 * (self._operator.cpu() - before) / QUIET
        resident, peak = self._operator.resident(), self._operator.peak()
        return {"idle_cpu_percent": round(idle, 2), "resident_mib": round(resident, 1), "peak_mib": round(peak, 1)}

    def _turn_next(self) -> None:
        self._turn(self._next)

    def _turn_all(self) -> None:
        for namespace in self._turns:
            self._turn(namespace)

    def _turn(self, namespace: str) -> None:
        self._turns[namespace] = not self._turns[namespace]
        self._bus.put(f"{namespace}/turn", json.dumps({"left": self._turns[namespace]}))


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
