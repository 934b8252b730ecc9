"""The loads under which `tests.bench.datastore` looks at the node, on a node that runs."""

from __future__ import annotations

import time
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Self, TypeVar

from prometheus_client.parser import text_string_to_metric_families

from tests.bench import kine_rows
from tests.bench.footprint.processes import cpu, written
from tests.bench.reaction.patch import BarePatch
from tests.bench.reaction.rounds import operated
from tests.bench.reaction.site import AGENT, PLAIN, SPARE, Site, say
from tests.bench.reaction.stopwatch import MissedError, Stopwatch
from tests.e2e.cluster import run
from tests.node import components, processes
from tests.node.layout import ROOT

if TYPE_CHECKING:
    from collections.abc import Callable

    import zenoh

    from tests.bench.reaction.operated import Operated

Turn = TypeVar("Turn")

PODS, POLICY = 8, "bench"
STORM, MINUTE = 1.0, 60.0
"""Seconds between two contexts: of a robot that is always busy, and of one that does something else each minute."""
WARM_UP = 30
"""Contexts, one a second, that are not measured: statuses and Events begin with a burst that an hour has once."""
DRAINED = 10.0
"""Seconds after which nothing of a load is left to do."""
DATABASE = ROOT / "kine" / "state.db"


class Counters:
    """The node's counters. `_flushed` are bytes that we wrote in the datastore's place."""

    def __init__(self) -> None:
        self._store, self._flushed = components.datastore(), 0

    @property
    def is_kine(self) -> bool:
        """Whether the rows of the datastore can be counted."""
        return self._store == "kine"

    def now(self) -> Load:
        """What the node has done by now; nothing waits in the datastore's log then."""
        if self.is_kine:
            self._flushed += kine_rows.checkpoint(DATABASE)
        store, kubelet = _process(self._store), _process("kubelet")
        bytes_of = written(store) + self._flushed, written(kubelet)
        return Load(time.monotonic(), _requests(), cpu(_process("apiserver")), cpu(store), *bytes_of)


@dataclass(frozen=True)
class Load:
    """What the node had done by a moment; bytes are those that the kernel accounts to storage."""

    at: float
    requests: float
    api_cpu: float
    store_cpu: float
    store_bytes: int
    kubelet_bytes: int

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


class Loads:
    """Two operators, one with an agent, and eight pods of each; what a load needs is made when it begins."""

    def __init__(self, turns: int, minutes: int) -> None:
        self._turns, self._minutes = turns, minutes
        self._names = [f"task-{number}" for number in range(PODS)]
        self._counters, self._end = Counters(), ExitStack()

    def __enter__(self) -> Self:
        self._stopwatch = self._end.enter_context(Stopwatch())
        self._site = self._end.enter_context(Site(self._stopwatch))
        self._site.pods(SPARE, ["patched"])
        self._buses = {PLAIN: self._site.operator(PLAIN), AGENT: self._site.operator(AGENT, agent=True)}
        for namespace in self._buses:
            self._site.pods(namespace, self._names)
        return self

    def __exit__(self, *_: object) -> None:
        self._end.close()

    def measures(self) -> dict[str, Callable[[], Any]]:
        """How each step is measured, by name."""
        return {
            "rest": self._rest,
            "storm_agent": partial(self._turning, AGENT, self._names, self._turns, STORM),
            "minute_agent": partial(self._turning, AGENT, self._names[:2], self._minutes, MINUTE),
            "storm": partial(self._turning, PLAIN, self._names, self._turns, STORM),
            "plans": self._plans,
            "patches": self._patches,
            "minute": partial(self._turning, PLAIN, self._names[:2], self._minutes, MINUTE),
        }

    def _rest(self) -> dict[str, float]:
        """Both operators have a policy, and nothing moves."""
        paths = [self._governed(namespace, self._names) for namespace in self._buses]
        time.sleep(DRAINED)
        found = self._loaded(lambda: None, self._minutes, MINUTE)
        for path in paths:
            path.close()
        return found

    def _turning(self, namespace: str, names: list[str], times: int, interval: float) -> dict[str, float]:
        """A plan at each interval; of two tasks only the first one's limit moves."""
        path = self._governed(namespace, names)
        _paced(path.turn, WARM_UP, STORM)
        time.sleep(0.0 if interval == STORM else DRAINED)
        found = self._loaded(path.turn, times, interval)
        path.close()
        time.sleep(DRAINED)
        return found

    def _plans(self) -> list[float]:
        path = self._governed(PLAIN, self._names)
        found = _paced(path.go, self._turns, STORM)
        path.close()
        return [one["all cgroups"] for one in found]

    def _patches(self) -> list[float]:
        bare = BarePatch(SPARE, {"patched": self._site.groups[SPARE]["patched"]}, self._stopwatch)
        found = _paced(bare.go, self._turns, STORM)
        bare.close()
        return [one["all cgroups"] for one in found]

    def _governed(self, namespace: str, names: list[str]) -> Operated:
        bus: zenoh.Session = self._buses[namespace]
        return operated(self._site, self._stopwatch, namespace, bus, names)

    def _loaded(self, act: Callable[[], object], times: int, interval: float) -> dict[str, float]:
        """What `act` costs, done at each interval."""
        rows = kine_rows.Tally(kine_rows.open_database(DATABASE)) if self._counters.is_kine else None
        before = self._counters.now()
        with rows or nullcontext():
            _paced(act, times, interval)
        return {**self._counters.now().since(before), **(rows.figures(POLICY) if rows else {})}


def _paced(act: Callable[[], Turn], times: int, interval: float) -> list[Turn]:
    """One at each interval; those that missed a stage are reported and left out."""
    found = []
    for _ in range(times):
        due = time.monotonic() + interval
        try:
            found.append(act())
        except MissedError as error:
            say(str(error))
        time.sleep(max(0.0, due - time.monotonic()))
    return found


def _requests() -> float:
    """All requests that the API server answered, ours for its metrics among them."""
    text = run("kubectl", "get", "--raw", "/metrics")
    samples = (sample for family in text_string_to_metric_families(text) for sample in family.samples)
    return sum(sample.value for sample in samples if sample.name == "apiserver_request_total")


def _process(name: str) -> int:
    process = processes.alive(name)
    assert process is not None, f"{name} does not run"
    return process
