"""What the weights of the operator and of the control plane on a saturated node do to the reaction."""

from __future__ import annotations

import json
import time
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from tests.bench.reaction.figures import medians
from tests.bench.reaction.rounds import PAUSE, RESTING, WORKING, operated
from tests.bench.reaction.site import LOAD, LOADS, PLAIN, say
from tests.bench.reaction.stopwatch import MissedError
from tests.e2e.cluster import run
from tests.node import cgroups

if TYPE_CHECKING:
    import zenoh

    from tests.bench.reaction.journal import Journal
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


@dataclass(frozen=True)
class Case:
    """One choice of weights."""

    tasks_request: str
    operator_request: str
    control_plane: int

    @property
    def step(self) -> str:
        """Its name in the journal."""
        return f"priority: tasks {self.tasks_request}, operator {self.operator_request}, node x{self.control_plane}"


def cases() -> list[Case]:
    """Each request of the tasks with each of the operator; then the control plane's weight alone."""
    found = [Case(tasks, operator, CONTROL_PLANE[1]) for tasks in TASKS for operator in OPERATOR]
    weights = CONTROL_PLANE if _own_node() else ()
    return list(dict.fromkeys([*found, *(Case(TASKS[0], OPERATOR[1], weight) for weight in weights)]))


def measure(site: Site, stopwatch: Stopwatch, bus: zenoh.Session, journal: Journal) -> None:
    """One row for each choice of weights; they are moved in place, nothing restarts."""
    if not journal.left_of(case.step for case in cases()):
        return
    names = [f"task-{number}" for number in range(PODS)]
    site.pods(PLAIN, names)
    site.load()
    path = operated(site, stopwatch, PLAIN, bus, names)
    try:
        for case in cases():
            journal.once(case.step, lambda case=case: [_row(site, path, case)])  # type: ignore[misc]
    finally:
        path.close()
        _weigh(Case(TASKS[0], OPERATOR[1], CONTROL_PLANE[1]))  # what requests they hold, others of this node can't have


def _row(site: Site, path: Operated, case: Case) -> dict[str, Any]:
    _weigh(case)
    return {**asdict(case), **_saturated(site, path)}


def _weigh(case: Case) -> None:
    _request_tasks(case.tasks_request)
    _request_own(case.operator_request)
    if _own_node():
        _weigh_control_plane(case.control_plane)


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
    """Medians of one stretch of work, and how many of its rounds missed a stage."""
    time.sleep(RESTING)
    site.quiet.wait()
    site.saturate(on=True)
    until = time.monotonic() + WORKING
    found, missed = [], 0
    try:
        while time.monotonic() < until:
            time.sleep(PAUSE)
            try:
                found.append(path.go())
            except MissedError as error:
                missed += 1
                say(str(error))
    finally:
        site.saturate(on=False)
    return {**medians(found, STAGES), "n": len(found), "missed": missed}


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
