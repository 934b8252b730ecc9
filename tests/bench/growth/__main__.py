"""How the operator grows: 1 to 100 policies, 1 to 300 containers, 1 to 1000 samples a second.

    python -m tests.bench.growth [--only policies,containers,samples] [--rounds 20]
    python -m tests.bench.growth --resume

Each point has an operator and a real API server of its own, without kubelets (see tests.bench.fleet). A reaction is
from the sample to the first and to the last PATCH that the API accepts; CPU and memory are those of the operator's own
process. Beside them stand as many bare PATCHes at once, or live's hand-over and engine at the same rate. A real node
carries fewer containers: the transitions of tests.bench.reaction, if it was run, are drawn into the curve.

Prints tables, writes build/bench/growth.json and draws growth.svg beside it (with --only: growth-<sweeps>); progress
goes to stderr. Each point is in growth.jsonl as soon as it is measured: a run that ended early goes on with --resume,
which only draws again when nothing is left.
"""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import argparse
import json
import signal
import sys
from typing import Any

from contextpolicy.policy.spec import Transition
from tests.bench.engine_measure import machine
from tests.bench.growth.curves import draw
from tests.bench.growth.sweeps import SWEEPS, measure
from tests.bench.reaction.figures import IDLE
from tests.bench.reaction.journal import Journal, opened
from tests.bench.reaction.report import part
from tests.bench.results import OUTPUT, keep, named, some_of


def main() -> int:
    options = _options()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    name = named("growth", options.only, SWEEPS)
    steps = {_step(sweep, size): (sweep, size) for sweep in options.only for size in SWEEPS[sweep]}
    kept = {"only": list(options.only), "rounds": options.rounds}
    journal = opened(OUTPUT / f"{name}.jsonl", kept, list(steps), resume=options.resume)
    try:
        for step, point in steps.items():
            journal.once(step, lambda: measure(*point, options.rounds))  # noqa: B023 - called at once
    finally:
        result = _result(options, journal)
        keep(name, result)
        draw(result, OUTPUT / f"{name}.svg")
    print("\n\n".join([str(result["machine"]), *(part(sweep, result[sweep]) for sweep in options.only)]))
    return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench.growth", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", type=some_of(SWEEPS), default=tuple(SWEEPS), help=f"some of {','.join(SWEEPS)}")
    parser.add_argument("--rounds", type=int, default=20, help="reactions at each point (%(default)s)")
    parser.add_argument("--resume", action="store_true", help="go on with a run of the same options that ended early")
    return parser.parse_args()


def _result(options: argparse.Namespace, journal: Journal) -> dict[str, Any]:
    """All that was measured, in this run and in those that it goes on with."""
    sweeps = {
        sweep: [found for size in SWEEPS[sweep] if (found := journal.found(_step(sweep, size)))]
        for sweep in options.only
    }
    return {**sweeps, "node": _node(), "machine": machine(), "left": journal.left()}


def _step(sweep: str, size: int) -> str:
    return f"{sweep}: {size}"


def _node() -> list[dict[str, Any]]:
    """Of the real node: until all limits of a plan are in force, with the same transition, and idle."""
    file = OUTPUT / "reaction.json"
    if not file.exists():
        return []
    rows = json.loads(file.read_text(encoding="utf-8")).get("transition", [])
    return [row for row in rows if (row["node"], row["path"]) == (IDLE, Transition.PROMPT.value)]


if __name__ == "__main__":
    sys.exit(main())
