"""A robot on the real node: pods as tasks, a thread as sensors, and a look into the kernel's files."""

from __future__ import annotations

import json
import os
import signal
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from tests.e2e.background import Background
from tests.e2e.cluster import CommandError, apply, delete, get, run, until
from tests.planning.builders import limited
from timelines.demo.cgroup import Cgroup, find

if TYPE_CHECKING:
    from collections.abc import Mapping

    import zenoh

RATE = 50.0
IDLE = ["python3", "-c", "import signal; signal.pause()"]
BUSY = ["python3", "-c", "while True: pass"]


class Sensors(Background):
    """Publishes the current readings `rate` times a second; a reading that is None is a silent sensor."""

    def __init__(self, session: zenoh.Session, rate: float = RATE) -> None:
        super().__init__(self._publish)
        self._session, self._rate = session, rate
        self._readings: dict[str, bytes | None] = {}

    def read(self, key: str, value: object) -> None:
        """From now on the sensor reads this; bytes go out as they are."""
        self._readings[key] = value if isinstance(value, bytes) or value is None else json.dumps(value).encode()

    def _publish(self) -> None:
        while not self._stop.wait(1 / self._rate):
            for key, payload in list(self._readings.items()):
                if payload is not None:
                    self._session.put(key, payload)


class Robot:
    """One namespace with tasks and policies."""

    def __init__(self, namespace: str, sensors: Sensors) -> None:
        self.namespace, self.sensors = namespace, sensors
        self._uids: dict[str, str] = {}
        """UIDs of policies by name, also of deleted ones."""

    def drive(self, speed: float) -> None:
        """The IMU says that the robot moves at `speed` m/s, or stands still at 0."""
        self.sensors.read(f"{self.namespace}/imu", {"gyro": [0.0, 0.0, speed], "speed": speed})

    def hear(self, level: float) -> None:
        """The microphone says how loud it is."""
        self.sensors.read(f"{self.namespace}/mic", {"level": level})

    def start(self, *tasks: str, command: list[str] = IDLE, resources: dict[str, Any] | None = None) -> None:
        """Start a pod for each task and wait until they run."""
        apply(*(pod(task, self.namespace, command, resources) for task in tasks))
        for task in tasks:
            run("kubectl", "wait", f"pod/{task}", "-n", self.namespace, "--for=condition=Ready", "--timeout=60s")

    def stop(self, *tasks: str) -> None:
        """Delete the tasks' pods."""
        for task in tasks:
            delete("pod", task, self.namespace)

    def policy(self, **changes: Any) -> None:
        """Apply the robot's policy, with some spec fields changed."""
        apply(policy(self.namespace, **changes))
        self._uid("robot")

    def status(self, name: str = "robot") -> dict[str, Any]:
        """What the policy's status says."""
        found: dict[str, Any] = get("ctxp", name, self.namespace).get("status", {})
        return found

    def condition(self, kind: str, name: str = "robot") -> tuple[str, str]:
        """The status and message of a condition."""
        for condition in self.status(name).get("conditions", []):
            if condition["type"] == kind:
                return condition["status"], condition["message"]
        return "", ""

    def reported(self, reason: str, name: str = "robot") -> list[str]:
        """The messages of the policy's Events with this reason, without those of earlier policies of the same name."""
        chosen = f"involvedObject.uid={self._uid(name)},reason={reason}"
        found = run("kubectl", "get", "events", "-n", self.namespace, "--field-selector", chosen, "-o", "json")
        return [event["message"] for event in json.loads(found)["items"]]

    def _uid(self, name: str) -> str:
        """The policy's UID, or that of the last one with this name; empty if there was none."""
        with suppress(CommandError):
            self._uids[name] = get("ctxp", name, self.namespace)["metadata"]["uid"]
        return self._uids.get(name, "")

    def container(self, task: str) -> Cgroup | None:
        """The cgroup of the task's container."""
        statuses = get("pod", task, self.namespace)["status"].get("containerStatuses", [])
        return find(statuses[0]["containerID"]) if statuses and statuses[0].get("containerID") else None

    def limits(self, *tasks: str) -> dict[str, int]:
        """What the kernel enforces, in thousandths of a core."""
        found = {task: self.container(task) for task in tasks}
        return {task: round((cgroup.limit() or 0) * 1000) for task, cgroup in found.items() if cgroup}

    def api_limit(self, task: str) -> str:
        """The CPU limit that the API has for the task, as it writes it."""
        limit: str = get("pod", task, self.namespace)["spec"]["containers"][0]["resources"]["limits"]["cpu"]
        return limit

    def kill(self, task: str) -> None:
        """SIGKILL the task's processes."""
        cgroup = self.container(task)
        assert cgroup is not None
        for pid in cgroup.processes():
            os.kill(pid, signal.SIGKILL)

    def restarts(self, task: str) -> int:
        """How often the kubelet restarted the task's container."""
        status = get("pod", task, self.namespace)["status"]["containerStatuses"][0]
        return int(status["restartCount"]) if "running" in status["state"] else -1

    def expect(self, **limits: int) -> None:
        """Wait until the kernel enforces these limits, in thousandths of a core."""

        def enforced() -> object:
            now = self.limits(*limits)
            return True if now == limits else now

        until(f"the kernel enforces {limits}", enforced)


def together(cgroups: Mapping[str, Cgroup]) -> dict[str, int] | None:
    """The limits that the kernel enforces at one moment, in thousandths of a core; None when they changed meanwhile.

    Files are read one by one, and the reader may have to wait between two: what was seen counts only if it is still the
    same at a second look.
    """
    first, second = ({task: round((c.limit() or 0) * 1000) for task, c in cgroups.items()} for _ in range(2))
    return first if first == second else None


def pod(task: str, namespace: str, command: list[str], resources: dict[str, Any] | None) -> dict[str, Any]:
    """A pod that stands for a task."""
    limited = {"requests": {"cpu": "10m", "memory": "32Mi"}, "limits": {"cpu": "500m", "memory": "64Mi"}}
    container = {
        "name": task,
        "image": "contextpolicy:dev",
        "imagePullPolicy": "IfNotPresent",
        "command": command,
        "resources": limited if resources is None else resources,
    }
    return {
        "apiVersion": "v1",
        "kind": "Pod",
        "metadata": {"name": task, "namespace": namespace, "labels": {"app": task}},
        "spec": {"terminationGracePeriodSeconds": 0, "containers": [container]},
    }


def policy(namespace: str, name: str = "robot", **changes: Any) -> dict[str, Any]:
    """Two tasks that share alike while the robot stands; while it moves, slam gets what speech must give.

    Under Limit unless the changes say otherwise: there a share is what the kernel enforces.
    """
    spec = {
        "reserve": "1",
        "streams": [{"name": "imu", "key": f"{namespace}/imu", "staleAfter": "1s"}],
        "tasks": [task("slam"), task("speech")],
        "contexts": [{"name": "moving", "when": "imu.speed > 0.05", "tasks": {"speech": {"suspend": True}}}],
    }
    return {
        "apiVersion": "contextpolicy.dev/v1alpha1",
        "kind": "ContextPolicy",
        "metadata": {"name": name, "namespace": namespace},
        "spec": limited({**spec, **changes}),
    }


def task(name: str, **more: Any) -> dict[str, Any]:
    """A task of the policy that selects the pod of its name."""
    labels: Mapping[str, str] = {"app": name}
    return {"name": name, "selector": {"matchLabels": labels}, **more}
