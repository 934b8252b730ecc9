"""What a sample costs the running operator, beside what it must cost: CPU time of the process per sample.

    python -m tests.bench.live [--rounds N]

A router and each subject are processes of their own on loopback; this one publishes. The subjects take turns within
each round, so what else the machine does meets all of them:

    bare      a Zenoh callback that takes the payload, and nothing else
    hand-over that callback, and a queue to another thread
    engine    decoding and planning of the same samples at the same rate, from memory, in one thread
    operator  the operator's runtime with a stand-in cluster; its policy reads every sample, and none changes a plan

`live_over_floor` is operator / (hand-over + engine), at 200 Hz. In a storm each sample makes another plan;
`storm_over_single` is how long the newest takes from its sample until its limits are in force, over a plan that comes
alone. The stand-in cluster takes 20 ms for a limit. Prints a table, writes build/bench/live.json; progress goes to
stderr.
"""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import argparse
import sys
import time
from contextlib import ExitStack
from statistics import median
from typing import TYPE_CHECKING, Any

import zenoh

from contextpolicy.bus.session import open_visitor
from tests.bench.child import Child
from tests.bench.engine_measure import machine
from tests.bench.live_case import KEYS, steady, stormy
from tests.bench.results import keep

if TYPE_CHECKING:
    from collections.abc import Callable

ENDPOINT = "tcp/127.0.0.1:17449"
RATES = (50, 200, 1000)
SECONDS, SETTLING = 2.0, 0.3
STORM_RATE, STORM_SECONDS = 1000, 2.0
KINDS = ("bare", "hand-over", "operator")
GOALS = {"live_over_floor": 1.2, "storm_over_single": 1.3}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    result = measure(options.rounds)
    keep("live", result)
    print(_table(result))
    return 0


def measure(rounds: int) -> dict[str, Any]:
    """All cases, `rounds` times each; figures are medians over the rounds."""
    with ExitStack() as stack:
        stack.enter_context(Child("-m", "contextpolicy", "router", "--listen", ENDPOINT))
        subjects = {
            kind: stack.enter_context(Child("-m", "tests.bench.live_subject", kind, ENDPOINT))
            for kind in (*KINDS, "engine", "storm")
        }
        session = stack.enter_context(open_visitor([ENDPOINT], patience=5.0))
        publishers = {
            kind: session.declare_publisher(key, express=True, congestion_control=zenoh.CongestionControl.BLOCK)
            for kind, key in KEYS.items()
        }
        time.sleep(1.0)  # until the subscriptions have travelled
        rows = [_row(rate, rounds, subjects, publishers) for rate in RATES]
        storm = _storm(rounds, subjects["storm"], publishers["storm"])
    at_200 = next(row for row in rows if row["rate"] == 200)
    return {
        "live_over_floor": at_200["over_floor"],
        "storm_over_single": storm["over_single"],
        "rates": rows,
        "storm": storm,
        "rounds": rounds,
        "machine": machine(),
    }


def _row(
    rate: int, rounds: int, subjects: dict[str, Child], publishers: dict[str, zenoh.Publisher]
) -> dict[str, float]:
    """One rate: medians in us per sample, and the median of each round's own ratio."""
    costs: dict[str, list[float]] = {kind: [] for kind in (*KINDS, "engine")}
    for number in range(rounds):
        print(f"{rate} Hz, round {number + 1} of {rounds}", file=sys.stderr, flush=True)
        for kind in KINDS:
            costs[kind].append(_cost(rate, subjects[kind], publishers[kind]))
        costs["engine"].append(subjects["engine"].ask(rate=rate, count=round(rate * SECONDS))["us"])
    ratios = [
        live / (floor + engine)
        for live, floor, engine in zip(costs["operator"], costs["hand-over"], costs["engine"], strict=True)
    ]
    return {"rate": rate, **{kind: median(of_kind) for kind, of_kind in costs.items()}, "over_floor": median(ratios)}


def _cost(rate: int, subject: Child, publisher: zenoh.Publisher) -> float:
    """CPU time in us per sample; none is lost, the publisher would wait."""
    time.sleep(SETTLING)
    before, count = subject.ask()["cpu"], round(rate * SECONDS)
    _publish(publisher, rate, count, steady)
    time.sleep(SETTLING)
    return float((subject.ask()["cpu"] - before) / count * 1e6)


def _publish(publisher: zenoh.Publisher, rate: float, count: int, payload: Callable[[int], bytes]) -> float:
    """Publish at a rate; returns the monotonic time of the last."""
    begin = at = time.monotonic()
    for number in range(count):
        time.sleep(max(0.0, begin + number / rate - time.monotonic()))
        at = time.monotonic()
        publisher.put(payload(number))
    return at


def _storm(rounds: int, subject: Child, publisher: zenoh.Publisher) -> dict[str, float]:
    """In ms: how long the plan of a single sample takes, and that of the last of a storm."""
    single, newest, cpu, count = [], [], [], round(STORM_RATE * STORM_SECONDS)
    for number in range(rounds):
        print(f"storm, round {number + 1} of {rounds}", file=sys.stderr, flush=True)
        _force(subject, publisher, last=0)
        single.append(_force(subject, publisher, last=1))
        before = subject.ask()["cpu"]
        newest.append(_force(subject, publisher, last=0, count=count))
        cpu.append((subject.ask()["cpu"] - before) / count * 1e6)
    return {
        "rate": STORM_RATE,
        "single_ms": median(single),
        "newest_ms": median(newest),
        "us_per_sample": median(cpu),
        "over_single": median(newest) / median(single),
    }


def _force(subject: Child, publisher: zenoh.Publisher, *, last: int, count: int = 1) -> float:
    """Publish samples, the last of which asks for a plan of its own; returns the ms until that is in force."""
    time.sleep(1.0)
    at = _publish(publisher, STORM_RATE, count, lambda number: stormy(number, last if number == count - 1 else None))
    time.sleep(1.0)
    return float((subject.ask()["in_force"][last] - at) * 1e3)


def _table(result: dict[str, Any]) -> str:
    lines = [f"{result['machine']}", "", "   Hz    bare  hand-over  engine  operator us  over floor"]
    lines += [
        f"{row['rate']:5}  {row['bare']:6.0f}  {row['hand-over']:9.0f}  {row['engine']:6.0f}  {row['operator']:11.0f}"
        f"  {row['over_floor']:10.2f}"
        for row in result["rates"]
    ]
    storm = result["storm"]
    reported = (
        f"storm of {storm['rate']} plans a second: {storm['us_per_sample']:.0f} us a sample; the newest is in force "
        f"after {storm['newest_ms']:.0f} ms, a plan alone after {storm['single_ms']:.0f} ms"
    )
    lines += ["", reported]
    lines += [f"  {name:18} {result[name]:5.2f}   goal <= {goal}" for name, goal in GOALS.items()]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
