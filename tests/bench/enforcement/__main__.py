"""When does moving the CPU with the context beat a fixed division, and what does it cost?

    python -m tests.bench.enforcement [--quick] [--blocks 10] [--resume | --report] [--output DIR] [--only PART ...]

Six synthetic tasks in cgroups of their own share two processors, without Kubernetes. Contexts follow a script and
change which task is critical; one controller writes what a division wants, as the agent does. Factors are never mixed:
the same gating, the same queues and the same inputs for everybody who is compared. The cells that a goal compares are
run once in each block, in another order in each, and all others twice after them. Needs root, a CPU controller (cgroup
version 1, or 2 without realtime), and a quiet machine.

Writes enforcement.jsonl (a line for each run, as it ends), enforcement.md, enforcement.json and enforcement.svg. A full
run takes less than two hours, --quick seven minutes: two loads, one block, shorter contexts, the newest input only.
--report runs nothing, and needs no root: it writes the others again from the first, also during a run.
"""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import argparse
import json
import signal
import sys
from pathlib import Path

from tests.bench.enforcement.campaign import Campaign, Options
from tests.bench.enforcement.data import values
from tests.bench.enforcement.goals import verdicts
from tests.bench.enforcement.matrix import CONFLICTING, LIGHT, LOADS
from tests.bench.enforcement.picture import draw
from tests.bench.enforcement.report import text
from tests.bench.enforcement.search import FINALISTS
from tests.bench.json_lines import OtherRunError

REPOSITORY = Path(__file__).parents[3]
OUTPUT = REPOSITORY / "build" / "bench"
QUICK = Options(loads=(LIGHT, CONFLICTING), seconds=2.0, blocks=1, finalists=1, lossless=False)
FULL = Options(loads=LOADS, seconds=4.0, blocks=10, finalists=FINALISTS, lossless=True)


def main() -> int:
    arguments = _arguments()
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: sys.exit(1))  # as after Ctrl-C, nothing is left behind
    options = (QUICK if arguments.quick else FULL).replaced(arguments.blocks, attempts=arguments.attempts)
    file = arguments.output / "enforcement.jsonl"
    if arguments.report and not file.exists():
        sys.exit(f"{file}: no such file")
    try:
        campaign = Campaign(options, file, arguments.only, resume=arguments.resume or arguments.report)
    except OtherRunError as error:
        sys.exit(f"{error}: leave --resume out to measure again")
    try:
        if not arguments.report:
            campaign.run()
    except KeyboardInterrupt:
        print("stopped; --resume goes on", file=sys.stderr)
        return 130
    finally:
        about, judged = campaign.about(), verdicts(campaign.journal.figures)
        report = text(campaign.journal, campaign.cells, campaign.left_out, about, judged)
        file.with_suffix(".md").write_text(report, encoding="utf-8")
        file.with_suffix(".json").write_text(
            json.dumps(values(campaign.journal, about, judged), indent=1) + "\n", encoding="utf-8"
        )
        draw(campaign.journal, file.with_suffix(".svg"))
    print(report)
    return 0


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench.enforcement",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--quick", action="store_true", help="seven minutes instead of two hours")
    parser.add_argument("--blocks", type=int, help="how often each cell is run (10; quick: 1)")
    parser.add_argument("--resume", action="store_true", help="go on with a run of the same options that ended early")
    parser.add_argument("--report", action="store_true", help="only write the report again, of what is measured so far")
    parser.add_argument("--output", type=Path, default=OUTPUT, metavar="DIR", help="where to (build/bench)")
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="PART", help="only cells whose name has all of these, as `load 1.3`"
    )
    parser.add_argument(
        "--attempts",
        action="store_true",
        help="also what was tried to reach missed goals; with --resume beside what is there",
    )
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
