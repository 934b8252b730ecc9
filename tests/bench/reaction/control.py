"""`control: Limit`, `Weight` and `Suspend` on the same load: one task takes all it can get, one is half idle."""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Any

from tests.bench.reaction import objects
from tests.bench.reaction.figures import rounded
from tests.bench.reaction.site import PLAIN
from tests.e2e.cluster import apply, run, until

if TYPE_CHECKING:
    from tests.bench.reaction.journal import Journal
    from tests.bench.reaction.site import Site
    from timelines.demo.cgroup import Cgroup

CONTROLS = ("Limit", "Weight", "Suspend")
BUSY, HALF = "busy", "half-idle"
SETTLE, WINDOW = 2.0, 10.0
RESERVE = "1"
"""Weights are CPU requests, and those of all pods of the node must fit: the operator's are among them."""


def step(control: str) -> str:
    """The name of one control's rows in the journal."""
    return f"control: {control}"


def measure(site: Site, journal: Journal) -> None:
    """One row for each task and control."""
    for control in CONTROLS:
        journal.once(step(control), lambda control=control: _rows(site, control))  # type: ignore[misc]


def _rows(site: Site, control: str) -> list[dict[str, Any]]:
    site.workers(PLAIN, {BUSY: (2, 1.0), HALF: (1, 0.5)})
    groups = {name: site.groups[PLAIN][name] for name in (BUSY, HALF)}
    apply(objects.policy_of(PLAIN, {**_spec(), "enforcement": {"control": control}}))
    until(f"control {control} is in force", lambda: _in_force(control, groups))
    site.quiet.wait()
    site.signal(PLAIN, groups, on=True)
    try:
        time.sleep(SETTLE)
        began, before = time.time(), {name: _counters(group) for name, group in groups.items()}
        time.sleep(WINDOW)
        ended, after = time.time(), {name: _counters(group) for name, group in groups.items()}
    finally:
        site.signal(PLAIN, groups, on=False)
    run("kubectl", "delete", "ctxp", "bench", "-n", PLAIN, "--timeout=60s")
    return [_row(control, name, began, ended, (before[name], after[name])) for name in groups]


def _row(
    control: str, name: str, began: float, ended: float, counters: tuple[dict[str, float], dict[str, float]]
) -> dict[str, Any]:
    before, after = counters
    grown = {key: after[key] - before[key] for key in after}
    jobs = _jobs(name, began, ended)
    return {
        "control": control,
        "task": name,
        "cores": round(grown["usage"] / (ended - began), 2),
        "jobs_per_second": round(len(jobs) / (ended - began), 1),
        "job_ms_p50": rounded(jobs, 50),
        "job_ms_p99": rounded(jobs, 99),
        "throttled_periods_percent": round(100 * grown["throttled"] / max(1, grown["periods"])),
    }


def _spec() -> dict[str, Any]:
    """Both tasks matter alike."""
    return {
        "reserve": RESERVE,
        "streams": [{"name": "turn", "key": f"{PLAIN}/turn"}],
        "tasks": [objects.task(name, max="2") for name in (BUSY, HALF)],
    }


def _in_force(control: str, groups: dict[str, Cgroup]) -> bool:
    """A weight says itself only in the request; a limit in the kernel."""
    limits = {group.limit() for group in groups.values()}
    pods = json.loads(run("kubectl", "get", "pods", *groups, "-n", PLAIN, "-o", "json"))["items"]
    actual = [pod["status"]["containerStatuses"][0]["resources"]["requests"]["cpu"] for pod in pods]
    moved = all(request != objects.WORKER_REQUEST for request in actual)
    return (2.0 not in limits if control == "Limit" else limits == {2.0}) and moved == (control == "Weight")


def _counters(group: Cgroup) -> dict[str, float]:
    return {"usage": group.usage(), **group.throttling()}


def _jobs(name: str, began: float, ended: float) -> list[float]:
    """The milliseconds that each job of the window took."""
    lines = [json.loads(line) for line in run("kubectl", "logs", name, "-n", PLAIN).splitlines()]
    return [took for line in lines if began <= line["at"] <= ended for took in line["took"]]
