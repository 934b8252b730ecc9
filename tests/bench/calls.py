"""How many Python calls a change of context takes, from Zenoh's callback until the API server is asked for resizes.

    python -m tests.bench.calls [--output table|json] [--changes N]

The time they take differs between machines and days, their number does not: what a change of the code costs shows here
first. A running operator governs the delivery robot, which starts and stops; its contexts begin and end without delay.
Zenoh, the API server and the kubelet are stand-ins. Medians, after a warm-up, of the calls from the callback's entry

    first   until the first resize is handed over
    last    until the last one is
    idle    until all threads wait, for the API server's answers or for the next sample

What `sys.setprofile` reports as a call counts, on all threads: each call of a Python function, the start of each
generator and each time it goes on, and until Python 3.12 each comprehension. C functions (json, msgspec, Zenoh) do not
count, nor do the stand-ins and what they call.

Python runs one thread at a time. The workers that send resizes run as soon as the loop lets go of the interpreter: when
it publishes the plan, else when it waits. Elsewhere it never has to, here; on a busy machine they may miss the first of
these moments, and `first` is nearly `idle`.
"""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import argparse
import json
import logging
import sys
from io import StringIO
from typing import TYPE_CHECKING, Any

from tests.bench.calls_counter import by_file, own, shown, until_quiet
from tests.bench.calls_robot import Robot

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tests.bench.calls_counter import Call

FIGURES = ("first", "last", "idle")
GOAL = 450
"""Calls until the first resize."""
WARM_UP = 3
FILES = 10
"""How many the table shows."""
WHOLE_TURN = 10.0
"""Seconds after which a thread has to let go of the interpreter."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", choices=("table", "json"), default="table")
    parser.add_argument("--changes", type=int, default=10)
    options = parser.parse_args()
    result = measure(options.changes)
    print(json.dumps(result, indent=2) if options.output == "json" else _table(result))
    return 0


def measure(changes: int) -> dict[str, Any]:
    """Each figure's median, the files of the first one's, and the first of each change."""
    sys.setswitchinterval(WHOLE_TURN)
    logging.basicConfig(level="INFO", stream=StringIO())
    robot = Robot()
    made = [_figures(*robot.change()) for _ in range(WARM_UP + changes)][WARM_UP:]
    medians = {figure: _median([change[figure] for change in made]) for figure in FIGURES}
    return {
        **{figure: _summary(calls) for figure, calls in medians.items()},
        "by_file": {shown(file): count for file, count in by_file(medians["first"]).most_common()},
        "changes": [len(change["first"]) for change in made],
    }


def _figures(calls: Sequence[Call], first: int, last: int) -> dict[str, Sequence[Call]]:
    """The calls of each figure."""
    return {"first": calls[:first], "last": calls[:last], "idle": calls[: until_quiet(calls, last)]}


def _median(made: Sequence[Sequence[Call]]) -> Sequence[Call]:
    return sorted(made, key=len)[(len(made) - 1) // 2]


def _summary(calls: Sequence[Call]) -> dict[str, int]:
    ours = own(calls)
    return {"calls": len(calls), "files": len(by_file(calls)), "own": len(ours), "own_files": len(by_file(ours))}


def _table(result: dict[str, Any]) -> str:
    lines = ["       calls  in files  operator's own  in files"]
    for figure in FIGURES:
        row = result[figure]
        lines.append(f"{figure:5}{row['calls']:7}{row['files']:10}{row['own']:16}{row['own_files']:10}")
    lines += [f"goal: first <= {GOAL}", "", "first, by file:"]
    lines += [f"{count:7}  {file}" for file, count in list(result["by_file"].items())[:FILES]]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
