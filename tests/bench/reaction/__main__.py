"""How long from a sample to the CPU limit in the kernel, side by side with the alternatives, on a real node.

    python -m tests.node exec -- python -m tests.bench.reaction [--only table,storm,transition,...] [--rounds 20]
    python -m tests.node exec -- python -m tests.bench.reaction --resume

Needs the image contextpolicy:dev on the node (`make bench-reaction` sees to that) and to run as root on that node.
Prints tables, writes build/bench/reaction.json (with --only: reaction-<parts>.json); progress goes to stderr. Each step
is in reaction.jsonl as soon as it is measured: a run that ended early loses nothing, and goes on with --resume. A
reaction that misses a stage is counted as missed. What it creates has names that begin with bench-, and is removed at
the end.
"""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import argparse
import signal
import sys
from typing import TYPE_CHECKING, Any

from tests.bench.engine_measure import machine
from tests.bench.reaction import autoscaler, control, priority, quiet, report, rounds, storm, transition
from tests.bench.reaction.figures import Figures
from tests.bench.reaction.journal import Journal, opened
from tests.bench.reaction.site import AGENT, PLAIN, Site
from tests.bench.reaction.stopwatch import MissedError, Stopwatch
from tests.bench.results import OUTPUT, keep, named, some_of
from tests.e2e.cluster import CommandError
from tests.node.errors import ClusterError

if TYPE_CHECKING:
    from collections.abc import Callable

PARTS = ("table", "storm", "transition", "priority", "control", "autoscaler")


def main() -> int:
    options = _options()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    name = named("reaction", options.only, PARTS)
    journal = opened(OUTPUT / f"{name}.jsonl", _kept(options), _steps(options), resume=options.resume)
    problems: dict[str, Any] = {"unmeasured": {}, "disturbed": 0}
    try:
        _measure(options, journal, problems)
    finally:
        result = _result(options, journal, problems)
        keep(name, result)
    print(report.text(result))
    return 1 if journal.left() else 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench.reaction",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--only", type=some_of(PARTS), default=PARTS, help=f"some of {','.join(PARTS)}")
    parser.add_argument("--rounds", type=int, default=20, help="reactions of each path in each case (%(default)s)")
    parser.add_argument("--resume", action="store_true", help="go on with a run of the same options that ended early")
    parser.add_argument(
        "--patience", type=float, default=quiet.BUDGET, help="seconds to wait for quiet moments, in all (%(default)s)"
    )
    return parser.parse_args()


def _kept(options: argparse.Namespace) -> dict[str, Any]:
    """What has to be the same in a run that goes on."""
    return {"only": list(options.only), "rounds": options.rounds}


def _steps(options: argparse.Namespace) -> list[str]:
    """What the parts are measured in, in order."""
    made = {
        "table": [rounds.step(node, size) for size in rounds.SIZES for node in rounds.NODES],
        "storm": [storm.step(namespace) for namespace in _namespaces(options)],
        "transition": transition.steps(),
        "priority": [case.step for case in priority.cases()],
        "control": [control.step(name) for name in control.CONTROLS],
        "autoscaler": [autoscaler.STEP],
    }
    return [step for part in options.only for step in made[part]]


def _namespaces(options: argparse.Namespace) -> list[str]:
    """One for each operator: with an agent, where a part uses it."""
    return [PLAIN, AGENT] if {"table", "storm"} & set(options.only) else [PLAIN]


def _measure(options: argparse.Namespace, journal: Journal, problems: dict[str, Any]) -> None:
    """Fill the journal with the steps that are left; what can't be measured is listed in the problems."""
    if not journal.left():
        return
    with Stopwatch() as stopwatch, Site(stopwatch, options.patience) as site:
        buses = {namespace: site.operator(namespace, agent=namespace == AGENT) for namespace in _namespaces(options)}
        made: dict[str, Callable[[], None]] = {
            "table": lambda: rounds.Rounds(site, stopwatch, journal, problems, options.rounds).measure(buses),
            "storm": lambda: storm.measure(site, stopwatch, buses, journal),
            "transition": lambda: transition.measure(site, stopwatch, buses[PLAIN], journal, options.rounds),
            "priority": lambda: priority.measure(site, stopwatch, buses[PLAIN], journal),
            "control": lambda: control.measure(site, journal),
            "autoscaler": lambda: autoscaler.measure(site, stopwatch, journal, options.rounds),
        }
        for part in options.only:
            try:
                made[part]()
            except (MissedError, CommandError, ClusterError) as error:  # the others can still be measured
                problems["unmeasured"][part] = str(error)
            problems["disturbed"] = site.quiet.disturbed


def _result(options: argparse.Namespace, journal: Journal, problems: dict[str, Any]) -> dict[str, Any]:
    """All that was measured, in this run and in those that it goes on with."""
    figures = Figures()
    for size, node in ((size, node) for size in rounds.SIZES for node in rounds.NODES):
        figures.note(node, size, journal.found(rounds.step(node, size)))
    parts = {
        part: [row for step in _steps(options) if step.startswith(f"{part}:") for row in journal.found(step)]
        for part in options.only
        if part not in ("table", "transition")
    }
    if "transition" in options.only:
        parts["transition"] = transition.rows(journal)
    reported = {**problems, "missed": figures.missed, "left": journal.left()}
    return {
        **figures.keys(),
        **transition.keys(journal),
        "machine": machine(),
        "table": figures.rows(),
        "peers": figures.peers(),
        **parts,
        **reported,
    }


if __name__ == "__main__":
    sys.exit(main())
