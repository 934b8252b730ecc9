"""How fast the engine decides: samples in bytes to plans, on one core.

    python -m tests.bench.engine [--profile] [--quick]

Prints a table, writes build/bench/engine.json; progress goes to stderr. In each case one stream in five drives a score
that is new with each sample (so each of its samples makes a plan), the others' samples mostly confirm what is known.
Samples per second are of one core's time; sample to plan is wall time. Both are of the quietest of several rounds: what
the engine costs, not what else the machine does.

Machines differ, and one differs from day to day, so each case takes its floor in the same run: decoding the samples
with `json.loads`, and the CEL evaluations that they need (`engine_floor`). `engine_over_floor` is of samples that
change nothing. The resizer's figures are the loop's own time for a plan, until every limit is in force, and for news
about a pod that no policy has to do with.
"""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import argparse
import gc
import sys
from dataclasses import asdict

from tests.bench.engine_case import CASES, NAMED, Case
from tests.bench.engine_measure import Measurement, machine, measure, profile
from tests.bench.engine_process import idle_cpu_percent, resident_mb
from tests.bench.engine_resizer import BYSTANDERS, LIMITS, loop_ms_per_plan, loop_us_per_bystander
from tests.bench.results import keep

GOALS = {
    "samples_per_second": (">=", 20_000.0),
    "sample_to_plan_p99_us": ("<", 1000.0),
    "engine_over_floor": ("<=", 2.5),
    "plan_over_60_us": ("<=", 1.0),
    "resident_mb": ("<", 110.0),
    "idle_cpu_percent": ("<", 1.0),
    "resizer_loop_ms_per_plan": ("<", 100.0),
    "resizer_us_per_bystander": ("<", 100.0),
}
REFERENCE_FLOOR_US = 15.4
"""The named case's floor on the machine that the goals are written for: when this engine took 22,000 samples a second
there, a sample cost 2.96 times its floor."""
PLAN_US = 60.0
"""What a plan for the named case's tasks may take on that machine, its sample included."""


def main() -> int:
    options = _options()
    if options.profile:
        print(profile(NAMED))
        return 0
    result = _measure(quick=options.quick)
    keep("engine", result)
    print(_table(result))
    return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--profile", action="store_true", help="show where the named case's time goes")
    parser.add_argument("--quick", action="store_true", help="the named case only")
    return parser.parse_args()


def _measure(*, quick: bool) -> dict[str, object]:
    cases = (NAMED,) if quick else (NAMED, *CASES)
    gc.freeze()  # as the operator does at its start
    rows = []
    for number, case in enumerate(cases, start=1):
        print(f"{number}/{len(cases)} {case}", file=sys.stderr, flush=True)
        rows.append(measure(case))
    print("resident memory and idle CPU, each in a process of its own", file=sys.stderr, flush=True)
    return {
        **_named(rows[0]),
        "plan_over_60_us": rows[0].beside.plan_us / (PLAN_US * rows[0].beside.plan_floor_us / REFERENCE_FLOOR_US),
        "resident_mb": resident_mb(),
        "idle_cpu_percent": idle_cpu_percent(),
        "resizer_loop_ms_per_plan": loop_ms_per_plan(),
        "resizer_us_per_bystander": loop_us_per_bystander(),
        "named_case": str(NAMED),
        "machine": machine(),
        "cases": [_row(case, row) for case, row in zip(cases, rows, strict=True)],
    }


def _named(measured: Measurement) -> dict[str, object]:
    return {
        "samples_per_second": measured.samples_per_second,
        "sample_to_plan_p50_us": measured.plan_p50_us,
        "sample_to_plan_p99_us": measured.plan_p99_us,
        "engine_over_floor": _over(measured.beside.quiet_us, measured.beside.quiet_floor_us),
        "plan_over_floor": _over(measured.beside.plan_us, measured.beside.plan_floor_us),
        **asdict(measured.beside),
    }


def _over(cost: float | None, floor: float | None) -> float | None:
    return cost / floor if cost and floor else None


def _row(case: Case, measured: Measurement) -> dict[str, object]:
    size = {"streams": case.streams, "tasks": case.tasks, "contexts": case.contexts}
    return size | _named(measured) | {"samples": measured.samples, "plans": measured.plans}


def _table(result: dict[str, object]) -> str:
    rows = result["cases"]
    assert isinstance(rows, list)
    lines = [
        f"{result['machine']}",
        "",
        "streams tasks contexts  samples/s  plan p50 us  p99 us  plans/samples   unchanged/floor us   plan/floor us",
    ]
    lines += [
        f"{row['streams']:7} {row['tasks']:5} {row['contexts']:8} {row['samples_per_second']:10.0f} "
        f"{row['sample_to_plan_p50_us']:12.0f} {row['sample_to_plan_p99_us']:7.0f}  {row['plans']:5}/{row['samples']}"
        f"   {_beside(row['quiet_us'], row['quiet_floor_us'])}  {_beside(row['plan_us'], row['plan_floor_us'])}"
        for row in rows
    ]
    lines += ["", f"{result['named_case']}; resizer: a plan of {LIMITS} limits beside {BYSTANDERS} other pods:"]
    for name, (sign, goal) in GOALS.items():
        lines.append(f"  {name:24} {result[name]:10.2f}   goal {sign} {goal:g}")
    return "\n".join(lines)


def _beside(cost: float | None, floor: float | None) -> str:
    return f"{cost:6.1f}/{floor:4.1f} = {cost / floor:4.1f}" if cost and floor else f"{'':18}"


if __name__ == "__main__":
    sys.exit(main())
