"""How long from a sample to the CPU limit in the kernel, side by side with the alternatives, on a real node.

    python -m tests.node exec -- python -m tests.bench.reaction [--only table,storm,priority,control] [--rounds 20]

Needs the image contextpolicy:dev on the node (`make bench-reaction` sees to that) and to run as root on that node.
Prints tables, writes build/bench/reaction.json (with --only: reaction-<parts>.json); progress goes to stderr. What it
creates has names that begin with bench-, and is removed at the end.
"""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import argparse
import json
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tests.bench.engine_measure import machine
from tests.bench.reaction import control, priority, report, storm
from tests.bench.reaction.figures import AGENT as AGENT_PATH
from tests.bench.reaction.figures import Figures
from tests.bench.reaction.rounds import Rounds
from tests.bench.reaction.site import AGENT, PLAIN, Site
from tests.bench.reaction.stopwatch import MissedError, Stopwatch
from tests.e2e.cluster import CommandError

if TYPE_CHECKING:
    from collections.abc import Callable

OUTPUT = Path(__file__).parents[3] / "build" / "bench"
PARTS = ("table", "storm", "priority", "control")


def main() -> int:
    options = _options()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    result = _measure(options)
    OUTPUT.mkdir(parents=True, exist_ok=True)
    partly = "" if options.only == PARTS else "-" + "-".join(options.only)
    (OUTPUT / f"reaction{partly}.json").write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    print(json.dumps(result, indent=2) if options.output == "json" else report.text(result))
    return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench.reaction",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--output", choices=("table", "json"), default="table")
    parser.add_argument("--only", type=_parts, default=PARTS, help=f"some of {','.join(PARTS)}")
    parser.add_argument("--rounds", type=int, default=20, help="reactions of each path in each case (%(default)s)")
    parser.add_argument("--no-agent", action="store_true", help="leave the node agent's path out")
    return parser.parse_args()


def _parts(text: str) -> tuple[str, ...]:
    chosen = tuple(part for part in PARTS if part in text.split(","))
    if not chosen or set(text.split(",")) - set(PARTS):
        raise argparse.ArgumentTypeError(f"{text!r}: one or more of {','.join(PARTS)}")
    return chosen


def _measure(options: argparse.Namespace) -> dict[str, Any]:
    figures = Figures()
    parts: dict[str, list[dict[str, Any]]] = {}
    with Stopwatch() as stopwatch, Site(stopwatch) as site:
        buses = {PLAIN: site.operator(PLAIN)}
        if options.no_agent:
            figures.unmeasured[AGENT_PATH] = "left out by --no-agent"
        elif {"table", "storm"} & set(options.only):
            buses[AGENT] = site.operator(AGENT, agent=True)
        made: dict[str, Callable[[], list[dict[str, Any]]]] = {
            "table": lambda: Rounds(site, stopwatch, figures, options.rounds).measure(buses),
            "storm": lambda: storm.measure(site, stopwatch, buses),
            "priority": lambda: priority.measure(site, stopwatch, buses[PLAIN]),
            "control": lambda: control.measure(site),
        }
        for part in options.only:
            try:
                parts[part] = made[part]()
            except (MissedError, CommandError) as error:  # the minutes of the others' figures must not be lost with it
                figures.unmeasured[part] = str(error)
    problems = {"unmeasured": figures.unmeasured, "missed": figures.missed, "disturbed": site.quiet.disturbed}
    return {**figures.keys(), "machine": machine(), "table": figures.rows(), **parts, **problems}


if __name__ == "__main__":
    sys.exit(main())
