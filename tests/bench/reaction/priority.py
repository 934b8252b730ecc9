"""What the weights of the operator and of the control plane on a saturated node do to the reaction."""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Any

from tests.bench.reaction.figures import percentile
from tests.bench.reaction.rounds import PAUSE, RESTING, WORKING, operated
from tests.bench.reaction.site import LOAD, LOADS, PLAIN, say
from tests.bench.reaction.stopwatch import MissedError
from tests.e2e.cluster import run
from tests.node import cgroups

if TYPE_CHECKING:
    import zenoh

    from tests.bench.reaction.operated import Operated
    from tests.bench.reaction.site import Site
    from tests.bench.reaction.stopwatch import Stopwatch

PODS = 8
TASKS = ("10m", "150m")
"""CPU requests of the pods that saturate the node: what tasks should have, and what they should not."""
OPERATOR = ("10m", "100m", "300m")
CONTROL_PLANE = (1, 8)
"""The weight of the node's own components in default groups' (1024 shares); the test node has the second."""
STAGES = ("sample at the operator", "plan on the bus", "first patch accepted", "first cgroup", "all cgroups")


def measure(site: Site, stopwatch: Stopwatch, bus: zenoh.Session) -> list[dict[str, Any]]:
    """One row for each choice of weights; they are moved in place, nothing restarts."""
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
                rows.append(_row(tasks, operator, CONTROL_PLANE[1], _saturated(site, path)))
        _request_tasks(TASKS[0])  # what requests they hold, others of this node can't have
        _request_own(OPERATOR[1])
        for weight in CONTROL_PLANE if _own_node() else ():
            _weigh_control_plane(weight)
            rows.append(_row(TASKS[0], OPERATOR[1], weight, _saturated(site, path)))
    finally:
        path.close()
        if _own_node():
            _weigh_control_plane(CONTROL_PLANE[1])
    return rows


def _row(tasks: str, operator: str, control_plane: int, measured: dict[str, Any]) -> dict[str, Any]:
    return {"tasks_request": tasks, "operator_request": operator, "control_plane": control_plane, **measured}


def _own_node() -> bool:
    """Whether the node's components run in a group that is ours to weigh."""
    return cgroups.components_folder().is_dir()


def _weigh_control_plane(weight: int) -> None:
    folder = cgroups.components_folder()
    shares = folder / "cpu.shares"
    if shares.exists():
        shares.write_text(str(1024 * weight))
    else:
        (folder / "cpu.weight").write_text(str(100 * weight))


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
