"""kine on SQLite against etcd under the node's API server: reaction, load on the API, bytes written to disk.

    python -m tests.bench.datastore [--turns 60] [--repeat 2]

Starts the node on one datastore after the other, so nobody else may use it meanwhile. Needs the image contextpolicy:dev
on the node (`make images`). Writes build/bench/datastore.json; progress goes to stderr. An hour is extrapolated from
the stretch that was measured, which the table names.
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
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from prometheus_client.parser import text_string_to_metric_families

from tests.bench.engine_measure import machine
from tests.bench.reaction.figures import percentile
from tests.bench.reaction.patch import BarePatch
from tests.bench.reaction.rounds import operated
from tests.bench.reaction.site import PLAIN, SPARE, Site, say
from tests.bench.reaction.stopwatch import MissedError, Stopwatch
from tests.e2e.cluster import REPOSITORY, run
from tests.node import access, components, lifecycle, processes
from tests.node.layout import DATASTORE_VARIABLE

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

OUTPUT = REPOSITORY / "build" / "bench" / "datastore.json"
PODS = 8
INTERVAL = 1.0
"""Seconds between two contexts: what a robot that is always busy may have."""
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
        print(json.dumps(_here(options.turns)))
        return 0
    rows = [_on(store, options.turns) for _ in range(options.repeat) for store in components.DATASTORES]
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
    parser.add_argument("--turns", type=int, default=60, help="contexts, one a second (%(default)s)")
    parser.add_argument("--repeat", type=int, default=2, help="times that each datastore has its turn (%(default)s)")
    parser.add_argument("--here", action="store_true", help="measure the running node only; needs `tests.node exec`")
    return parser.parse_args()


def _on(store: str, turns: int) -> dict[str, Any]:
    say(f"{store}: starting the node")
    os.environ[DATASTORE_VARIABLE] = store
    lifecycle.up()
    argv = access.command([sys.executable, "-m", "tests.bench.datastore", "--here", "--turns", str(turns)])
    timeout = 300 + 4 * turns * INTERVAL
    done = subprocess.run(
        argv, env=access.environment(), cwd=REPOSITORY, stdout=subprocess.PIPE, timeout=timeout, check=True, text=True
    )
    measured: dict[str, Any] = json.loads(done.stdout)
    return {"datastore": store, **measured}


def _here(turns: int) -> dict[str, Any]:
    names = [f"task-{number}" for number in range(PODS)]
    with Stopwatch() as stopwatch, Site(stopwatch) as site:
        site.pods(SPARE, ["patched"])
        bare = BarePatch(SPARE, {"patched": site.groups[SPARE]["patched"]}, stopwatch)
        bus = site.operator(PLAIN)
        site.pods(PLAIN, names)
        path = operated(site, stopwatch, PLAIN, bus, names)
        time.sleep(10)  # what starting them left to do
        say("at rest")
        rest = _loaded(lambda: time.sleep(turns * INTERVAL))
        say("contexts")
        plans: list[dict[str, float]] = []
        turned = _loaded(lambda: plans.extend(_paced(path.go, turns)))
        say("bare PATCHes")
        patches = _paced(bare.go, turns)
        path.close()
        bare.close()
    return {
        "bare_patch_cgroup_ms": _spread([one["all cgroups"] for one in patches]),
        "plan_of_8_cgroups_ms": _spread([one["all cgroups"] for one in plans]),
        "at_rest": rest,
        "contexts": turned,
    }


def _loaded(work: Callable[[], object]) -> dict[str, float]:
    before = Load.now()
    work()
    return Load.now().since(before)


def _paced(go: Callable[[], dict[str, float]], turns: int) -> list[dict[str, float]]:
    """One at each interval; those that missed a stage are told and left out."""
    found = []
    for _ in range(turns):
        due = time.monotonic() + INTERVAL
        try:
            found.append(go())
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
    return "\n".join(f"{name:36}" + "".join(f"{row[name]!s:>10}" for row in flat) for name in flat[0])


def _flat(row: dict[str, Any]) -> dict[str, Any]:
    parts = {name: part if isinstance(part, dict) else {"": part} for name, part in row.items()}
    return {f"{name} {key}".strip(): value for name, part in parts.items() for key, value in part.items()}


if __name__ == "__main__":
    sys.exit(main())
