"""kine on SQLite against etcd under the node's API server: reaction, load on the API, bytes written to disk.

    python -m tests.bench.datastore [--datastores kine] [--turns 60] [--minutes 10] [--repeat 1]
    python -m tests.bench.datastore --goals [--resume]

Starts the node on one datastore after the other, so nobody else may use it meanwhile. Needs the image contextpolicy:dev
on the node (`make images`). Writes build/bench/datastore.json; progress goes to stderr. Two operators run, one with an
agent, and each governs eight pods:

    rest           nothing moves, for --minutes
    storm          a plan that moves all eight limits, each second, --turns times
    minute         a plan that moves one limit, each minute, --minutes times

each of the loads without the agent and with it. An hour is extrapolated from the stretch that was measured,
`above_rest` is less what was written at rest. One datastore takes about 8 + 3 * minutes + 5 * turns / 60 minutes.

`--goals` measures what the goals are about and nothing else, on kine, and says which are met: at rest, the storm with
the agent, contexts once a minute with it, and the storm without it; 20 minutes with its default of 5 `--minutes`. Each
step is in datastore.jsonl as soon as it is measured: with `--resume` a run that ended early goes on after it.

On kine the writes are also counted by kind, and `own_share_percent` is the part of status and Events of the policies in
the bytes of these and of all pods with their Events; see `tests/bench/kine_rows.py`.
"""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import argparse
import json
import logging
import os
import subprocess
import sys
from typing import TYPE_CHECKING, Any

from tests.bench.datastore_goals import LOADS, above, judged
from tests.bench.datastore_loads import MINUTE, STORM, Loads
from tests.bench.engine_measure import machine
from tests.bench.reaction.figures import percentile
from tests.bench.reaction.journal import opened
from tests.bench.reaction.site import say
from tests.bench.results import OUTPUT, keep
from tests.node import access, components, lifecycle
from tests.node.layout import DATASTORE_VARIABLE, REPOSITORY

if TYPE_CHECKING:
    from collections.abc import Sequence

EVERYTHING = ("rest", "storm", "storm_agent", "plans", "patches", "minute", "minute_agent")


def main() -> int:
    """With --here measure here, else start the node on each datastore and measure there."""
    options = _options()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    if options.here:
        print(json.dumps(_here(options)))
        return 0
    rows = [_on(store, options) for _ in range(options.repeat) for store in options.datastores]
    keep("datastore", {"machine": machine(), "rows": rows})
    print(_text(rows))
    for row in rows if options.goals else ():
        print("\n".join(judged(row)))
    return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench.datastore",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    every = tuple(components.DATASTORES)
    parser.add_argument("--datastores", nargs="+", choices=every, help="those to measure (all; kine with --goals)")
    parser.add_argument("--turns", type=int, default=60, help="contexts of the storm, one a second (%(default)s)")
    parser.add_argument("--minutes", type=int, help="at rest, and contexts one a minute (10; 5 with --goals)")
    parser.add_argument("--repeat", type=int, default=1, help="times that each datastore has its turn (%(default)s)")
    parser.add_argument("--goals", action="store_true", help="only what the goals are about")
    parser.add_argument("--resume", action="store_true", help="go on with a run of the same options that ended early")
    parser.add_argument("--here", action="store_true", help="measure the running node only; needs `tests.node exec`")
    options = parser.parse_args()
    options.datastores = options.datastores or (["kine"] if options.goals else every)
    options.minutes = options.minutes or (5 if options.goals else 10)
    if options.resume and len(options.datastores) * options.repeat > 1:
        parser.error("--resume: expected one datastore, once: name it with --datastores")
    return options


def _on(store: str, options: argparse.Namespace) -> dict[str, Any]:
    say(f"{store}: starting the node")
    os.environ[DATASTORE_VARIABLE] = store
    lifecycle.up()
    switches = [f"--{name}" for name in ("goals", "resume") if getattr(options, name)]
    stretches = ("--turns", str(options.turns), "--minutes", str(options.minutes), *switches)
    argv = access.command([sys.executable, "-m", "tests.bench.datastore", "--here", *stretches])
    timeout = 1200 + 12 * options.turns * STORM + 4 * options.minutes * MINUTE
    done = subprocess.run(
        argv, env=access.environment(), cwd=REPOSITORY, stdout=subprocess.PIPE, timeout=timeout, check=True, text=True
    )
    measured: dict[str, Any] = json.loads(done.stdout)
    return {"datastore": store, **measured}


def _here(options: argparse.Namespace) -> dict[str, Any]:
    steps = LOADS if options.goals else EVERYTHING
    same = {"datastore": components.datastore(), "turns": options.turns, "minutes": options.minutes}
    journal = opened(OUTPUT / "datastore.jsonl", same, steps, resume=options.resume)
    if journal.left():
        with Loads(options.turns, options.minutes) as loads:
            measures = loads.measures()
            for step in steps:
                journal.once(step, measures[step])
    return _row({step: journal.found(step) for step in steps})


def _row(found: dict[str, Any]) -> dict[str, Any]:
    rest = found["rest"]
    times = {"patches": "bare_patch_cgroup_ms", "plans": "plan_of_8_cgroups_ms"}
    loads = {name: load for name, load in found.items() if name not in times and name != "rest"}
    return {
        **{title: _spread(found[name]) for name, title in times.items() if name in found},
        "rest": rest,
        **{name: {**load, "above_rest_mib_per_hour": above(load, rest)} for name, load in loads.items()},
    }


def _spread(times: Sequence[float]) -> dict[str, float]:
    figures = {f"p{percent}": round(percentile(times, percent), 1) for percent in (50, 90)}
    return {**figures, "max": round(max(times), 1), "n": len(times)}


def _text(rows: Sequence[dict[str, Any]]) -> str:
    """One line for each figure, one column for each time that the node was started."""
    flat = [_flat(row) for row in rows]
    names = dict.fromkeys(name for row in flat for name in row)
    return "\n".join(f"{name:40}" + "".join(f"{row.get(name, '')!s:>10}" for row in flat) for name in names)


def _flat(row: dict[str, Any]) -> dict[str, Any]:
    parts = {name: part if isinstance(part, dict) else {"": part} for name, part in row.items()}
    return {f"{name} {key}".strip(): value for name, part in parts.items() for key, value in part.items()}


if __name__ == "__main__":
    sys.exit(main())
