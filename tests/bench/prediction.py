"""`python -m tests.bench.prediction`: what the model of `simulate --profiles` predicts against what the kernel does.

A robotkit task that burns a known amount of CPU for each input runs under a quota of CFS, and
gets inputs at 10 Hz. Its own profile says how it fared; the model is given the same inputs. Needs root and a CPU
controller, of cgroup v1 or v2. The group has the highest CPU weight, so that other load on the machine hardly counts.

`worst` are the misses that the model predicts for the least favourable phase of the kernel's periods.
"""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from contextpolicy.simulation.forecast import PHASES, stats
from contextpolicy.simulation.profiles import Cost
from contextpolicy.simulation.server import Allowance, Change, Server, Work, Worker
from tests.bench.cgroup import cgroup
from tests.bench.child import program
from tests.modules.robotkit.bus import client, router

if TYPE_CHECKING:
    from collections.abc import Iterator

    import zenoh

    from contextpolicy.simulation.forecast import Stats
    from tests.bench.cgroup import Cgroup

PERIOD, RATE, DEADLINE = 0.1, 10.0, 0.1
WORK = (0.02, 0.03, 0.04, 0.05, 0.06, 0.08, 0.11)
"""Quantiles of the CPU seconds of an input."""
BURN = """\
import sys, time
from pathlib import Path
from robotkit import Task, main
class Burn(Task):
    def process(self, received):
        end = time.thread_time() + float(received.payload)
        while time.thread_time() < end:
            pass
        return {}
main(Path(sys.argv[1]), Burn)
"""
PARKED = 1.0
"""Seconds for the last inputs to be done."""


@dataclass(frozen=True, slots=True)
class Case:
    """Cores and queue depth of each task, which all get the same inputs."""

    quota: float
    depth: int


CASES = [Case(quota, depth) for quota in (0.3, 0.45, 0.6, 0.8, 1.0) for depth in (1, 50)]


def main() -> int:
    """Print measured and predicted p50, p99 and misses for each case."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.prediction", description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each case (%(default)g)")
    seconds = parser.parse_args().seconds
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors, {seconds:g} s each, {RATE:g} Hz")
    print("quota  depth   p50 measured predicted    max measured, p99 predicted    misses measured predicted")
    for case in CASES:
        measured, background = _measure(case, seconds)
        predicted = predict(case, seconds, background)
        print(_row(case, measured, predicted), flush=True)
    return 0


def predict(case: Case, seconds: float, background: float) -> Stats:
    """The model's word."""
    cost = Cost("work", case.depth, WORK)
    arrivals = [Work(number / RATE, "burn", 0, cost.work(number)) for number in range(round(seconds * RATE))]
    outcomes = []
    for phase in range(PHASES):
        workers = {"burn": Worker([case.depth], 1.0, background)}
        server = Server(float(os.cpu_count() or 1), workers, PERIOD, phase / PHASES * PERIOD)
        server.serve(arrivals, [Change(0.0, {"burn": Allowance(1.0, case.quota)})], seconds + PARKED)
        outcomes += [one._replace(phase=phase) for one in server.outcomes]
    return stats(outcomes, DEADLINE)


def _measure(case: Case, seconds: float) -> tuple[dict[str, float], float]:
    cost = Cost("work", case.depth, WORK)
    with ExitStack() as stack:
        address = stack.enter_context(router())
        session = stack.enter_context(client(address))
        group = stack.enter_context(cgroup("prediction"))
        group.limit(case.quota)
        group.outweigh()
        stack.enter_context(_task(address, case.depth, group))
        publisher = session.declare_publisher("work")
        _profile(session)  # it is up
        start = time.monotonic()
        for number in range(round(seconds * RATE)):
            time.sleep(max(start + number / RATE - time.monotonic(), 0))
            stamp = json.dumps({"stamp": time.time_ns()}).encode()
            publisher.put(str(cost.work(number)).encode(), attachment=stamp)
        time.sleep(PARKED)
        after = _profile(session)
    own = after["inputs"]["work"]
    late, done, dropped = own["missed"], own["done"], own["dropped"]
    due = max(round(seconds * RATE), 1)
    quantiles = own["latency"]["quantiles"]
    misses = (late + dropped + max(due - done - dropped, 0)) / due
    return {"p50": quantiles[10], "p99": quantiles[20], "misses": misses}, float(after["background"])


def _profile(session: zenoh.Session) -> dict[str, Any]:
    for _ in range(50):
        for reply in session.get("robot/burn/profile", timeout=2):
            if reply.ok is not None:
                answer: dict[str, Any] = json.loads(reply.ok.payload.to_bytes())
                return answer
        time.sleep(0.2)
    raise SystemExit("the task does not answer")


@contextmanager
def _task(address: str, depth: int, group: Cgroup) -> Iterator[None]:
    with tempfile.TemporaryDirectory() as folder:
        module = Path(folder, "module.yaml")
        work = f"{{work: {{key: work, depth: {depth}}}}}"
        module.write_text(f"name: burn\ninputs: {work}\noutputs: {{done: {{key: done}}}}\nneeds: {{deadline: 100ms}}\n")
        burn = Path(folder, "burn.py")
        burn.write_text(BURN)
        with program(str(burn), str(module), group=group, ZENOH_CONNECT=address):
            yield


def _row(case: Case, measured: dict[str, float], predicted: Stats) -> str:
    def both(name: str, guess: float | None) -> str:
        return f"{measured[name] * 1000:8.0f} ms {(guess or 0) * 1000:6.0f} ms"

    misses = f"{measured['misses']:8.1%} {predicted.misses:9.1%}   worst {predicted.worst:.1%}"
    times = f"{both('p50', predicted.p50)}   {both('p99', predicted.p99)}"
    return f"{case.quota:5.2f}  {case.depth:5}   {times}   {misses}"


if __name__ == "__main__":
    sys.exit(main())
