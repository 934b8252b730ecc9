"""The curves' points: what is measured at each."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from tests.bench.fleet.crowd import Fleet
from tests.bench.fleet.run import started
from tests.bench.growth.driving import Driving, cost

if TYPE_CHECKING:
    from collections.abc import Callable

SWEEPS = {
    "policies": (1, 3, 10, 30, 100),
    "containers": (1, 3, 10, 30, 100, 300),
    "samples": (1, 10, 100, 300, 1000),
}
TASKS = 3
"""Of each policy, where these don't grow."""
MOST_TASKS = 100
"""A policy has at most 128; of more containers each task has several."""
QUIET = 10.0
"""Seconds for which an idle operator is watched."""


def measure(sweep: str, size: int, rounds: int) -> dict[str, Any]:
    """One point, with the machine's load at the end."""
    found = MEASURED[sweep](size, rounds)
    return {"size": size, **found, "load": round(os.getloadavg()[0], 1)}


def _policies(size: int, rounds: int) -> dict[str, float]:
    with started(Fleet(size, TASKS, pods=size * TASKS)) as run:
        run.start()
        return {
            **run.patch(rounds),
            **run.govern(),
            **run.react(rounds),
            **run.storm(),
            **run.rest(QUIET),
        }


def fleet_of(containers: int) -> Fleet:
    """A robot with so many."""
    tasks = min(containers, MOST_TASKS)
    return Fleet(1, tasks, replicas=containers // tasks, pods=containers)


def _containers(size: int, rounds: int) -> dict[str, float]:
    with started(fleet_of(size)) as run:
        run.start()
        return {**run.patch(rounds), **run.govern(), **run.react(rounds), **run.rest(QUIET)}


def _samples(size: int, rounds: int) -> dict[str, float]:
    fleet = Driving(1, TASKS, pods=TASKS)
    with started(fleet) as run:
        run.start()
        with fleet.drive(run.bus, min(SWEEPS["samples"])):  # no plan before a stream was heard
            run.govern()
        spent = cost(run, fleet, size)
        with fleet.drive(run.bus, size):
            reaction = run.react(rounds)
        reaction.pop("cpu_ms_per_plan")  # the samples' is in it
        return {**reaction, **spent, **run.rest(QUIET)}


MEASURED: dict[str, Callable[[int, int], dict[str, float]]] = {
    "policies": _policies,
    "containers": _containers,
    "samples": _samples,
}
