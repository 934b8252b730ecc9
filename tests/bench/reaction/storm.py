"""How long until the newest plan is in force: after a storm of contexts, where the plan turns every 5 ms for 2 s, and
of two plans 100 ms apart, as the `enterAfter` of a context makes them. Beside it what the kubelet makes of as many bare
PATCHes, once and twice, that nobody decides about."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from contextpolicy.actuators.following import SETTLED
from tests.bench.reaction.figures import rounded
from tests.bench.reaction.patch import BarePatch
from tests.bench.reaction.rounds import PAUSE, operated
from tests.bench.reaction.site import SPARE, say
from tests.bench.reaction.stopwatch import MissedError

if TYPE_CHECKING:
    import zenoh

    from tests.bench.reaction.journal import Journal
    from tests.bench.reaction.operated import Operated
    from tests.bench.reaction.site import Site
    from tests.bench.reaction.stopwatch import Stopwatch

PODS = 8
STORMS = 10
LENGTH, INTERVAL = 2.0, 0.005
APART = 0.1
"""Seconds between the two plans of a pair."""


def step(namespace: str) -> str:
    """The name of one path's storms in the journal."""
    return f"storm: {namespace}"


def measure(site: Site, stopwatch: Stopwatch, buses: dict[str, zenoh.Session], journal: Journal) -> None:
    """One row for each of our paths."""
    for namespace, bus in buses.items():
        journal.once(step(namespace), lambda at=(namespace, bus): [_row(site, stopwatch, *at)])  # type: ignore[misc]


def _row(site: Site, stopwatch: Stopwatch, namespace: str, bus: zenoh.Session) -> dict[str, Any]:
    names, spare = ([f"{kind}-{number}" for number in range(PODS)] for kind in ("task", "spare"))
    site.pods(namespace, names)
    site.pods(SPARE, spare)
    path = operated(site, stopwatch, namespace, bus, names)
    bare = BarePatch(SPARE, {name: site.groups[SPARE][name] for name in spare}, stopwatch)
    try:
        return _storms(site, path, bare)
    finally:
        path.close()
        bare.close()


def _storms(site: Site, path: Operated, bare: BarePatch) -> dict[str, Any]:
    calm, storms, pairs, bare_once, bare_pairs = [], [], [], [], []
    for _ in range(STORMS):
        site.quiet.wait()
        try:
            before = path.go()["all cgroups"]
            second = _pair(path)
            once, twice = _bare(bare)
            storms.append(_storm(path))
            calm.append(before)
            pairs.append(second)
            bare_once.append(once)
            bare_pairs.append(twice)
        except MissedError as error:
            say(str(error))
    after = [after for after, *_ in storms]
    return {
        "path": path.name,
        "pods": PODS,
        "calm_all_cgroups_ms_p50": rounded(calm, 50),
        "calm_all_cgroups_ms_max": rounded(calm, 100),
        "second_of_pair_ms_p50": rounded(pairs, 50),
        "second_of_pair_ms_max": rounded(pairs, 100),
        "bare_all_cgroups_ms_p50": rounded(bare_once, 50),
        "bare_second_of_pair_ms_p50": rounded(bare_pairs, 50),
        "bare_second_of_pair_ms_max": rounded(bare_pairs, 100),
        "after_storm_ms_p50": rounded(after, 50),
        "after_storm_ms_max": rounded(after, 100),
        "plans": rounded([plans for _, plans, _ in storms], 50),
        "resizes": rounded([resizes for *_, resizes in storms], 50),
        "n": len(storms),
        "missed": STORMS - len(storms),
    }


def _pair(path: Operated) -> float:
    """Milliseconds from the second sample until its plan is in force."""
    time.sleep(PAUSE)
    path.turn()
    time.sleep(APART)
    path.await_limits(last := path.turn())
    after = (time.time() - last) * 1e3
    time.sleep(PAUSE)
    return after


def _bare(bare: BarePatch) -> tuple[float, float]:
    """Milliseconds until the limits of one change are in force, and those of the second of a pair."""
    once = bare.go()["all cgroups"]
    time.sleep(PAUSE)
    twice = bare.pair(APART)
    time.sleep(PAUSE)
    return once, twice


def _storm(path: Operated) -> tuple[float, int, int]:
    """Milliseconds from the last sample until its plan is in force; how many plans and resizes there were."""
    began = time.time()
    while (last := path.turn()) < began + LENGTH:
        time.sleep(INTERVAL)
    path.await_limits(last)
    after = (time.time() - last) * 1e3
    time.sleep(SETTLED + PAUSE)  # an agent's resizes follow then: the next round must not begin before
    return after, path.plans_since(began), path.resizes_since(began)
