"""kine on SQLite against etcd under the node's API server: reaction, load on the API, bytes written to disk.

    python -m tests.bench.datastore [--datastores kine] [--turns 60] [--minutes 10] [--repeat 1]

Starts the node on one datastore after the other, so nobody else may use it meanwhile. Needs the image contextpolicy:dev
on the node (`make images`). Writes build/bench/datastore.json; progress goes to stderr. Two operators run, one with an
agent, and each governs eight pods:

    rest           nothing moves, for --minutes
    storm          a plan that moves all eight limits, each second, --turns times
    minute         a plan that moves one limit, each minute, --minutes times

each of the loads first without the agent, then with it. An hour is extrapolated from the stretch that was measured,
`above_rest` is less what was written at rest. One datastore takes about 8 + 3 * minutes + 4 * turns / 60 minutes.

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
import time
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from prometheus_client.parser import text_string_to_metric_families

from tests.bench import kine_rows
from tests.bench.engine_measure import machine
from tests.bench.reaction.figures import percentile
from tests.bench.reaction.patch import BarePatch
from tests.bench.reaction.rounds import operated
from tests.bench.reaction.site import AGENT, PLAIN, SPARE, Site, say
from tests.bench.reaction.stopwatch import MissedError, Stopwatch
from tests.e2e.cluster import REPOSITORY, run
from tests.node import access, components, lifecycle, processes
from tests.node.layout import DATASTORE_VARIABLE, ROOT

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

Turn = TypeVar("Turn")

OUTPUT = REPOSITORY / "build" / "bench" / "datastore.json"
PODS, POLICY = 8, "bench"
STORM, MINUTE = 1.0, 60.0
"""Seconds between two contexts: of a robot that is always busy, and of one that does something else each minute."""
WARM_UP = 30
"""Contexts of a storm that are not measured: statuses and Events begin with a burst that an hour has once."""
DRAINED = 10.0
"""Seconds after which nothing of a load is left to do."""
TICK = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Load:
    """What the node had done by a moment; bytes are those that the kernel accounts to storage."""

    at: float
    requests: float
    api_cpu: float
    store_cpu: float
    store_bytes: int
    kubelet_bytes: int

    @classmethod
    def now(cls) -> Load:
        """Read the counters."""
        store = components.datastore()
        return cls(time.monotonic(), _requests(), _cpu("apiserver"), _cpu(store), _written(store), _written("kubelet"))

    def since(self, before: Load) -> dict[str, float]:
        """Rates, and the bytes of an hour at this rate."""
        seconds = self.at - before.at
        hour = 3600 / seconds / 2**20
        return {
            "seconds": round(seconds, 1),
            "requests_per_s": round((self.requests - before.requests) / seconds, 1),
            "api_server_millicores": round((self.api_cpu - before.api_cpu) / seconds * 1000),
            "datastore_millicores": round((self.store_cpu - before.store_cpu) / seconds * 1000),
            "datastore_mib_per_hour": round((self.store_bytes - before.store_bytes) * hour, 1),
            "kubelet_mib_per_hour": round((self.kubelet_bytes - before.kubelet_bytes) * hour, 1),
        }


def main() -> int:
    """Measure here when told to, else start the node on each datastore and measure there."""
    options = _options()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    if options.here:
        print(json.dumps(_here(options.turns, options.minutes)))
        return 0
    rows = [_on(store, options) for _ in range(options.repeat) for store in options.datastores]
    OUTPUT.parent.mkdir(parents=True, exist_ok=True)
    OUTPUT.write_text(json.dumps({"machine": machine(), "rows": rows}, indent=2) + "\n", encoding="utf-8")
    print(_text(rows))
    return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench.datastore",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    every = tuple(components.DATASTORES)
    parser.add_argument("--datastores", nargs="+", choices=every, default=every, help="those to measure (all)")
    parser.add_argument("--turns", type=int, default=60, help="contexts of the storm, one a second (%(default)s)")
    parser.add_argument("--minutes", type=int, default=10, help="at rest, and contexts one a minute (%(default)s)")
    parser.add_argument("--repeat", type=int, default=1, help="times that each datastore has its turn (%(default)s)")
    parser.add_argument("--here", action="store_true", help="measure the running node only; needs `tests.node exec`")
    return parser.parse_args()


def _on(store: str, options: argparse.Namespace) -> dict[str, Any]:
    say(f"{store}: starting the node")
    os.environ[DATASTORE_VARIABLE] = store
    lifecycle.up()
    stretches = ("--turns", str(options.turns), "--minutes", str(options.minutes))
    argv = access.command([sys.executable, "-m", "tests.bench.datastore", "--here", *stretches])
    timeout = 900 + 12 * options.turns * STORM + 3 * options.minutes * MINUTE
    done = subprocess.run(
        argv, env=access.environment(), cwd=REPOSITORY, stdout=subprocess.PIPE, timeout=timeout, check=True, text=True
    )
    measured: dict[str, Any] = json.loads(done.stdout)
    return {"datastore": store, **measured}


def _here(turns: int, minutes: int) -> dict[str, Any]:
    names = [f"task-{number}" for number in range(PODS)]
    with Stopwatch() as stopwatch, Site(stopwatch) as site:
        site.pods(SPARE, ["patched"])
        bare = BarePatch(SPARE, {"patched": site.groups[SPARE]["patched"]}, stopwatch)
        buses = {PLAIN: site.operator(PLAIN), AGENT: site.operator(AGENT, agent=True)}
        for namespace in buses:
            site.pods(namespace, names)
        paths = {namespace: operated(site, stopwatch, namespace, bus, names) for namespace, bus in buses.items()}
        time.sleep(DRAINED)
        rest = _loaded("at rest", lambda: None, minutes, MINUTE)
        storm = {}
        for namespace, path in paths.items():
            _paced(path.turn, WARM_UP, STORM)
            storm[namespace] = _loaded(f"{namespace}: storm", path.turn, turns, STORM)
            time.sleep(DRAINED)
        say("plans, and bare PATCHes")
        plans = _paced(paths[PLAIN].go, turns, STORM)
        patches = _paced(bare.go, turns, STORM)
        minute = {}
        for namespace, bus in buses.items():
            paths[namespace].close()
            few = operated(site, stopwatch, namespace, bus, names[:2])  # of two tasks only the first one's limit moves
            time.sleep(DRAINED)
            minute[namespace] = _loaded(f"{namespace}: minute", few.turn, minutes, MINUTE)
            few.close()
        bare.close()
    loads = {"storm": storm[PLAIN], "storm_agent": storm[AGENT], "minute": minute[PLAIN], "minute_agent": minute[AGENT]}
    return {
        "bare_patch_cgroup_ms": _spread([one["all cgroups"] for one in patches]),
        "plan_of_8_cgroups_ms": _spread([one["all cgroups"] for one in plans]),
        "rest": rest,
        **{name: {**load, "above_rest_mib_per_hour": _above(load, rest)} for name, load in loads.items()},
    }


def _above(load: Mapping[str, float], rest: Mapping[str, float]) -> float:
    return round(load["datastore_mib_per_hour"] - rest["datastore_mib_per_hour"], 1)


def _loaded(what: str, act: Callable[[], object], times: int, interval: float) -> dict[str, float]:
    """What `act` costs, done at each interval."""
    say(what)
    rows = kine_rows.Tally(kine_rows.open_database(ROOT / "kine" / "state.db")) if _is_kine() else None
    before = Load.now()
    with rows or nullcontext():
        _paced(act, times, interval)
    return {**Load.now().since(before), **(rows.figures(POLICY) if rows else {})}


def _is_kine() -> bool:
    return components.datastore() == "kine"


def _paced(act: Callable[[], Turn], times: int, interval: float) -> list[Turn]:
    """One at each interval; those that missed a stage are told and left out."""
    found = []
    for _ in range(times):
        due = time.monotonic() + interval
        try:
            found.append(act())
        except MissedError as error:
            say(str(error))
        time.sleep(max(0.0, due - time.monotonic()))
    return found


def _spread(times: Sequence[float]) -> dict[str, float]:
    figures = {f"p{percent}": round(percentile(times, percent), 1) for percent in (50, 90)}
    return {**figures, "max": round(max(times), 1), "n": len(times)}


def _requests() -> float:
    """All requests that the API server answered, ours for its metrics among them."""
    text = run("kubectl", "get", "--raw", "/metrics")
    samples = (sample for family in text_string_to_metric_families(text) for sample in family.samples)
    return sum(sample.value for sample in samples if sample.name == "apiserver_request_total")


def _cpu(name: str) -> float:
    fields = (_folder(name) / "stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICK


def _written(name: str) -> int:
    lines = (_folder(name) / "io").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("write_bytes")).split()[1])


def _folder(name: str) -> Path:
    return Path("/proc") / str(processes.alive(name))


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
