"""The objects that the benchmark creates: pods that do nothing, pods that are busy, and policies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tests.bench.reaction.counted_work import COUNT, SIGNALLED
from tests.node.layout import PAUSE_IMAGE, TAG
from tests.planning.builders import limited

if TYPE_CHECKING:
    from collections.abc import Mapping

IMAGE = "contextpolicy:dev"
WORKER_REQUEST = "10m"
ORIGINAL = 0.5
"""The limit, in cores, that a pod comes with which only counts or does nothing."""
WORK = f"""{SIGNALLED}
processes, duty = int(sys.argv[1]), float(sys.argv[2])
def job(loops):
    began = time.monotonic()
    for _ in range(loops):
        pass
    return time.monotonic() - began
loops = int(100_000 * 0.01 / min(job(100_000) for _ in range(20)))
for _ in range(processes - 1):
    if os.fork() == 0:
        break
took, written, due = [], time.time(), 0.0
while True:
    now = time.monotonic()
    if now >= until:
        time.sleep(0.01)
        continue
    if duty < 1:
        due = max(due + 0.01 / duty, now)
        time.sleep(due - now)
    took.append(round(job(loops) * 1e3, 2))
    if time.time() > written + 0.25:
        written = time.time()
        os.write(1, json.dumps({{"at": written, "took": took}}).encode() + b"\\n")
        took = []
"""
"""Jobs of 10 ms of CPU; its arguments are the number of processes, and how much of a core each of them wants."""


def idle_pod(name: str, namespace: str) -> dict[str, Any]:
    """A task that does nothing: it is its limit that is measured."""
    return pod(name, namespace, {"image": f"{PAUSE_IMAGE}:{TAG}", "resources": _cpu("5m", str(ORIGINAL))})


def worker_pod(name: str, namespace: str, processes: int = 1, duty: float = 1.0) -> dict[str, Any]:
    """A pod that works on request, with the small request that tasks should have."""
    command = ["python3", "-c", WORK, str(processes), str(duty)]
    return pod(name, namespace, {"image": IMAGE, "command": command, "resources": _cpu(WORKER_REQUEST, "2")})


def counting_pod(name: str, namespace: str) -> dict[str, Any]:
    """A task that counts its work, of the size of an idle one."""
    resources = _cpu("5m", str(ORIGINAL))
    return pod(name, namespace, {"image": IMAGE, "command": ["python3", "-c", COUNT], "resources": resources})


def module_pod(name: str, namespace: str, environment: Mapping[str, str]) -> dict[str, Any]:
    """One of the robot's modules, without a limit."""
    settings = [{"name": key, "value": value} for key, value in environment.items()]
    return pod(name, namespace, {"image": f"contextpolicy-{name}:dev", "env": settings})


def scaled_pod(name: str, namespace: str, request: str, limit: float) -> dict[str, Any]:
    """A worker for an autoscaler, which keeps the ratio of limit and request."""
    made = worker_pod(name, namespace)
    made["spec"]["containers"][0]["resources"] = _cpu(request, str(limit))
    return made


def replicated(made: dict[str, Any]) -> dict[str, Any]:
    """A StatefulSet of this one pod: an autoscaler looks after controllers, not after pods."""
    metadata = made["metadata"]
    labels = {"matchLabels": metadata["labels"]}
    template = {"metadata": {"labels": metadata["labels"]}, "spec": made["spec"]}
    return {
        "apiVersion": "apps/v1",
        "kind": "StatefulSet",
        "metadata": metadata,
        "spec": {"selector": labels, "serviceName": metadata["name"], "template": template},
    }


def autoscaler(name: str, namespace: str, resource: str, **policy: Any) -> dict[str, Any]:
    """A VerticalPodAutoscaler for that StatefulSet, in place and of one resource, with more fields of its policy."""
    own = {"containerName": "*", "controlledResources": [resource], **policy}
    return {
        "apiVersion": "autoscaling.k8s.io/v1",
        "kind": "VerticalPodAutoscaler",
        "metadata": {"name": name, "namespace": namespace},
        "spec": {
            "targetRef": {"apiVersion": "apps/v1", "kind": "StatefulSet", "name": name},
            "updatePolicy": {"updateMode": "InPlace"},
            "resourcePolicy": {"containerPolicies": [own]},
        },
    }


def pod(name: str, namespace: str, container: dict[str, Any]) -> dict[str, Any]:
    """A pod of one container."""
    return {
        "apiVersion": "v1",
        "kind": "Pod",
        "metadata": {"name": name, "namespace": namespace, "labels": {"app": name}},
        "spec": {
            "terminationGracePeriodSeconds": 0,
            "automountServiceAccountToken": False,
            "enableServiceLinks": False,
            "containers": [{"name": name, "imagePullPolicy": "IfNotPresent", **container}],
        },
    }


def policy(namespace: str, names: list[str], reserve: str) -> dict[str, Any]:
    """Each sample turns the plan: what half of the tasks had, the other half gets. Of two tasks only the first moves.

    A single task could not move at all, as nobody else could have its share.
    """
    left, right = names[::2], names[1::2]
    contexts = [{"name": "left", "when": "turn.left", "tasks": {name: {"suspend": True} for name in left}}]
    if len(names) > 2:
        suspended = {name: {"suspend": True} for name in right}
        contexts.append({"name": "right", "when": "!turn.left", "tasks": suspended})
    bounds = {"max": "200m"} if len(names) == 2 else {}
    return policy_of(
        namespace,
        {
            "reserve": reserve,
            "streams": [{"name": "turn", "key": f"{namespace}/turn"}],
            "tasks": [task(name, **bounds) for name in names],
            "contexts": contexts,
        },
    )


def policy_of(namespace: str, spec: dict[str, Any]) -> dict[str, Any]:
    """The one policy of a namespace, under Limit unless the spec says otherwise: what is timed is a quota."""
    return {
        "apiVersion": "contextpolicy.dev/v1alpha1",
        "kind": "ContextPolicy",
        "metadata": {"name": "bench", "namespace": namespace},
        "spec": limited(spec),
    }


def task(name: str, **more: Any) -> dict[str, Any]:
    """A task that selects the pod of its name; it always matters."""
    return {"name": name, "selector": {"matchLabels": {"app": name}}, "idle": 1, **more}


def _cpu(request: str, limit: str) -> dict[str, Any]:
    return {"requests": {"cpu": request}, "limits": {"cpu": limit}}
