"""The objects of a fleet: nodes, a robot in each of many namespaces, and the pods of everybody else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import yaml

from tests.node.layout import REPOSITORY

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tests.bench.fleet.control_plane import ControlPlane

MERGE = "application/strategic-merge-patch+json"
CRD = REPOSITORY / "crds" / "contextpolicies.contextpolicy.dev.yaml"
DEFINITIONS = "/apis/apiextensions.k8s.io/v1/customresourcedefinitions"
OTHERS = "others"
EPOCH = "2026-01-01T00:00:00Z"


@dataclass(frozen=True)
class Fleet:
    """`robots` namespaces with one policy each on a node of its own, `replicas` pods of each of its `tasks`.

    With others, there are `pods` in all.
    """

    robots: int = 50
    tasks: int = 10
    replicas: int = 1
    pods: int = 5000

    @property
    def limits_of_one(self) -> int:
        """How many limits each plan changes: those of all containers of one policy."""
        return self.tasks * self.replicas

    @property
    def limits(self) -> int:
        """Those of all policies."""
        return self.robots * self.limits_of_one

    def namespace(self, robot: int) -> str:
        return f"robot-{robot:03}"

    def fill(self, plane: ControlPlane) -> None:
        """Create all but the policies."""
        plane.send("POST", DEFINITIONS, yaml.safe_load(CRD.read_text(encoding="utf-8")))
        namespaces = [OTHERS, *(self.namespace(robot) for robot in range(self.robots))]
        plane.send_all(("POST", "/api/v1/namespaces", _object("Namespace", name)) for name in namespaces)
        plane.send_all(("POST", "/api/v1/nodes", _node(f"node-{robot:03}")) for robot in range(self.robots))
        pods = list(self._pods())
        plane.send_all(("POST", _pods_of(pod), pod) for pod in pods)
        plane.send_all(("PATCH", f"{_path(pod)}/status", _running(pod), MERGE) for pod in pods)

    def govern(self, plane: ControlPlane) -> None:
        """Create the policies."""
        plane.send_all(
            ("POST", f"/apis/contextpolicy.dev/v1alpha1/namespaces/{name}/contextpolicies", self.policy(name))
            for name in map(self.namespace, range(self.robots))
        )

    def resize(self, plane: ControlPlane, cpu: str) -> None:
        """Set the CPU limits of the first robot's containers, at once and without any policy."""
        plane.send_all(("PATCH", f"{_path(pod)}/resize", _limit(pod, cpu), MERGE) for pod in self._robot_pods(0))

    def disturb(self, plane: ControlPlane, number: int) -> None:
        """One more status of a pod that is nobody's robot, as kubelets write them all the time."""
        name = f"pod-{number % (self._others):05}"
        ready = {"type": "Ready", "status": "True", "reason": f"Probe{number}"}
        patch = {"status": {"conditions": [ready]}}
        plane.send("PATCH", f"/api/v1/namespaces/{OTHERS}/pods/{name}/status", patch, MERGE)

    @property
    def _others(self) -> int:
        return self.pods - self.limits

    def _pods(self) -> Iterator[dict[str, Any]]:
        for robot in range(self.robots):
            yield from self._robot_pods(robot)
        for number in range(self._others):
            yield _pod(OTHERS, f"pod-{number:05}", "other", f"node-{number % self.robots:03}")

    def _robot_pods(self, robot: int) -> Iterator[dict[str, Any]]:
        for task in range(self.tasks):
            for replica in range(self.replicas):
                yield _pod(self.namespace(robot), f"task-{task}-{replica}", f"task-{task}", f"node-{robot:03}")

    def policy(self, namespace: str) -> dict[str, Any]:
        """Each sample turns the plan: what half of the tasks had, the other half gets.

        All at once: with the transition Strict the second half would wait until a kubelet has lowered the first.
        """
        names = [f"task-{task}" for task in range(self.tasks)]
        sides = {"left": ("turn.left", names[::2]), "right": ("!turn.left", names[1::2])}
        spec = {
            "enforcement": {"control": "Limit", "transition": "Prompt"},
            "streams": [{"name": "turn", "key": f"{namespace}/turn"}],
            "tasks": [{"name": name, "selector": {"matchLabels": {"app": name}}, "idle": 1} for name in names],
            "contexts": [
                {"name": side, "when": when, "tasks": {name: {"suspend": True} for name in suspended}}
                for side, (when, suspended) in sides.items()
                if suspended
            ],
        }
        return {**_object("ContextPolicy", "fleet", "contextpolicy.dev/v1alpha1"), "spec": spec}


def _object(kind: str, name: str, version: str = "v1") -> dict[str, Any]:
    return {"apiVersion": version, "kind": kind, "metadata": {"name": name}}


def _node(name: str) -> dict[str, Any]:
    size = {"cpu": "8", "memory": "32Gi", "pods": "200"}
    return {**_object("Node", name), "status": {"capacity": size, "allocatable": size}}


def _pods_of(pod: dict[str, Any]) -> str:
    return f"/api/v1/namespaces/{pod['metadata']['namespace']}/pods"


def _path(pod: dict[str, Any]) -> str:
    return f"{_pods_of(pod)}/{pod['metadata']['name']}"


def _limit(pod: dict[str, Any], cpu: str) -> dict[str, Any]:
    name = pod["spec"]["containers"][0]["name"]
    return {"spec": {"containers": [{"name": name, "resources": {"limits": {"cpu": cpu}}}]}}


def _pod(namespace: str, name: str, app: str, node: str) -> dict[str, Any]:
    """As large as pods are: probes, variables and volumes make an object of about 5 kB with its status and fields."""
    resources = {"requests": {"cpu": "10m", "memory": "64Mi"}, "limits": {"cpu": "500m", "memory": "128Mi"}}
    variables = [{"name": f"SETTING_{number}", "value": f"value-{number}-of-{name}"} for number in range(12)]
    probe = {"httpGet": {"path": "/healthz", "port": 8080}, "periodSeconds": 10}
    mounts = [{"name": f"volume-{number}", "mountPath": f"/data/{number}"} for number in range(3)]
    container = {
        "name": app,
        "image": f"registry.example.com/fleet/{app}:1.0.0",
        "resources": resources,
        "env": variables,
        "livenessProbe": probe,
        "readinessProbe": probe,
        "volumeMounts": mounts,
    }
    volumes = [{"name": mount["name"], "emptyDir": {}} for mount in mounts]
    labels = {"app": app, "app.kubernetes.io/part-of": "fleet", "pod-template-hash": "5d4f8c7b9"}
    return {
        "apiVersion": "v1",
        "kind": "Pod",
        "metadata": {"name": name, "namespace": namespace, "labels": labels},
        "spec": {"nodeName": node, "containers": [container], "volumes": volumes},
    }


def _running(pod: dict[str, Any]) -> dict[str, Any]:
    """What a kubelet says of a pod that runs; the API server resizes no container of unknown resources."""
    declared = pod["spec"]["containers"][0]
    container = {
        "name": declared["name"],
        "image": declared["image"],
        "imageID": f"registry.example.com/fleet/{declared['name']}@sha256:{'0' * 64}",
        "containerID": f"containerd://{pod['metadata']['namespace']}-{pod['metadata']['name']}",
        "ready": True,
        "started": True,
        "restartCount": 0,
        "resources": declared["resources"],
        "state": {"running": {"startedAt": EPOCH}},
    }
    kinds = ("PodReadyToStartContainers", "Initialized", "Ready", "ContainersReady", "PodScheduled")
    conditions = [{"type": kind, "status": "True", "lastTransitionTime": EPOCH} for kind in kinds]
    return {"status": {"phase": "Running", "conditions": conditions, "containerStatuses": [container]}}
