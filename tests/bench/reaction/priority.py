"""What the operator's CPU request, its weight on a saturated node, does to its reaction."""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Any

from tests.bench.reaction.figures import percentile
from tests.bench.reaction.rounds import PAUSE, RESTING, WORKING, operated
from tests.bench.reaction.site import LOAD, LOADS, PLAIN, say
from tests.bench.reaction.stopwatch import MissedError
from tests.e2e.cluster import run

if TYPE_CHECKING:
    import zenoh

    from tests.bench.reaction.operated import Operated
    from tests.bench.reaction.site import Site
    from tests.bench.reaction.stopwatch import Stopwatch

PODS = 8
TASKS = ("10m", "150m")
"""CPU requests of the pods that saturate the node: what tasks should have, and what they should not."""
OPERATOR = ("10m", "100m", "300m")
STAGES = ("sample at the operator", "plan on the bus", "first patch accepted", "first cgroup", "all cgroups")


def measure(site: Site, stopwatch: Stopwatch, bus: zenoh.Session) -> list[dict[str, Any]]:
    """One row for each pair of requests; they are moved in place, nothing restarts."""
    names = [f"task-{number}" for number in range(PODS)]
    site.pods(PLAIN, names)
    site.load()
    path = operated(site, stopwatch, PLAIN, bus, names)
    rows = []
    try:
        for tasks in TASKS:
            _request_tasks(tasks)
            for operator in OPERATOR:
                _request_own(operator)
                rows.append({"tasks_request": tasks, "operator_request": operator, **_saturated(site, path)})
        _request_tasks(TASKS[0])  # what requests they hold, others of this node can't have
        _request_own(OPERATOR[1])
    finally:
        path.close()
    return rows


def _request_tasks(cpu: str) -> None:
    for number in range(LOADS):
        _request(LOAD, f"load-{number}", cpu)


def _request_own(cpu: str) -> None:
    for pod in _own_pods():
        _request(PLAIN, pod, cpu)


def _saturated(site: Site, path: Operated) -> dict[str, Any]:
    """Medians of one stretch of work."""
    time.sleep(RESTING)
    site.quiet.wait()
    site.saturate(on=True)
    until = time.monotonic() + WORKING
    found = []
    try:
        while time.monotonic() < until:
            time.sleep(PAUSE)
            try:
                found.append(path.go())
            except MissedError as error:
                say(str(error))
    finally:
        site.saturate(on=False)
    medians = {f"{stage} ms p50": round(percentile([one[stage] for one in found], 50), 1) for stage in STAGES}
    return {**medians, "n": len(found)}


def _own_pods() -> list[str]:
    pods = json.loads(
        run("kubectl", "get", "pods", "-n", PLAIN, "-l", f"app.kubernetes.io/instance={PLAIN}", "-o", "json")
    )
    return [pod["metadata"]["name"] for pod in pods["items"]]


def _request(namespace: str, pod: str, cpu: str) -> None:
    """Move a pod's CPU request, and wait until the kubelet has done so."""
    say(f"{pod}: request {cpu}")
    name = json.loads(run("kubectl", "get", "pod", pod, "-n", namespace, "-o", "json"))["spec"]["containers"][0]["name"]
    patch = {"spec": {"containers": [{"name": name, "resources": {"requests": {"cpu": cpu}}}]}}
    run("kubectl", "patch", "pod", pod, "-n", namespace, "--subresource=resize", "--patch", json.dumps(patch))
    done = f"jsonpath={{.status.containerStatuses[0].resources.requests.cpu}}={cpu}"
    run("kubectl", "wait", f"pod/{pod}", "-n", namespace, f"--for={done}", "--timeout=20s")
