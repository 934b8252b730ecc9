"""An installation with node agents, and a look at what they do to the node."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Self, TypeAlias

from contextpolicy.bus.decision_bus import agent_key
from contextpolicy.bus.session import open_visitor
from tests.e2e.cluster import PATIENCE, apply, helm_command, run, secret_files, until
from tests.e2e.robot import together
from tests.node.layout import ROOT
from timelines.demo.cgroup import find
from timelines.demo.deploy import free_address

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from contextlib import AbstractContextManager

    import zenoh

    from tests.e2e.robot import Robot

SYSTEM, NAMESPACE, RELEASE = "e2e-agent-system", "e2e-agent", "e2e-agent"
ADDRESS = 49
PRIORITY = 10


Connect: TypeAlias = "Callable[[str], AbstractContextManager[zenoh.Session]]"


@contextmanager
def installed() -> Iterator[Connect]:
    """The operator, its router and agents, apart from any other installation; gives a way to its bus, by role."""
    apply({"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": NAMESPACE}})
    run(*install_command(), timeout=150)
    yield connect
    run("kubectl", "delete", "ctxp", "--all", "-n", NAMESPACE, "--timeout=60s")
    run("helm", "uninstall", RELEASE, "--namespace", SYSTEM, "--wait", "--timeout", "60s")
    run("kubectl", "delete", "namespace", SYSTEM, NAMESPACE, "--timeout=90s")


def install_command(**more: str) -> list[str]:
    """How the release is installed, or upgraded to `more` values."""
    values = {
        "fullnameOverride": RELEASE,
        "image.repository": "contextpolicy",
        "image.tag": "dev",
        "router.service.clusterIP": free_address(ADDRESS),
        "watchNamespaces": f"{{{NAMESPACE}}}",
        "agent.enabled": "true",
        "agent.settleSeconds": "2",
        "agent.realtime": "true",
        "agent.realtimePriority": str(PRIORITY),
        "agent.podLogs": str(ROOT / "pods"),
        **more,
    }
    return helm_command(RELEASE, SYSTEM, values)


@contextmanager
def connect(role: str) -> Iterator[zenoh.Session]:
    """A session of the role, with the certificate that the chart made for it."""
    with TemporaryDirectory() as directory:
        credentials = secret_files(f"{RELEASE}-bus-{role}", SYSTEM, Path(directory) / role)
        with open_visitor([endpoint()], patience=20, credentials=credentials) as session:
            yield session


def endpoint() -> str:
    """Where the router listens."""
    return f"tls/{free_address(ADDRESS)}:7447"


class Component:
    """A running part of the installation: operator, router or agent."""

    def __init__(self, name: str) -> None:
        self._name = name

    def send(self, number: signal.Signals) -> None:
        """Signal the component's processes."""
        for pid in self._processes():
            os.kill(pid, number)

    def kill(self) -> None:
        """SIGKILL; the kubelet starts it again."""
        self.send(signal.SIGKILL)

    def delete(self) -> None:
        """Delete the pod, which ends it with SIGTERM; another one takes its place."""
        run(
            "kubectl", "delete", "pod", "-n", SYSTEM, "-l", f"app.kubernetes.io/component={self._name}", "--timeout=60s"
        )

    def restarts(self) -> int:
        """How often its container was started again."""
        return int(self._status()["restartCount"])

    def wait(self) -> None:
        """Wait until it runs; the kubelet takes its time with one that was killed twice."""
        until(f"{self._name} runs", lambda: bool(self._processes()))

    def _processes(self) -> list[int]:
        cgroup = find(self._status().get("containerID", ""))
        return cgroup.processes() if cgroup else []

    def _status(self) -> dict[str, Any]:
        label = f"app.kubernetes.io/component={self._name}"
        pods = json.loads(run("kubectl", "get", "pods", "-n", SYSTEM, "-l", label, "-o", "json"))["items"]
        statuses: list[dict[str, Any]] = [s for pod in pods for s in pod["status"].get("containerStatuses", [])]
        return next((status for status in statuses if "running" in status["state"]), {"restartCount": -1})


def group(robot: Robot, task: str) -> Path:
    """The cgroup of the task's container."""
    cgroup = robot.container(task)
    assert cgroup is not None
    return cgroup.quota_file.parent


def report(session: zenoh.Session) -> dict[str, Any]:
    """What the node's agent says of itself."""
    [reply] = list(session.get(agent_key("*"), timeout=PATIENCE))
    assert reply.ok is not None, reply.err
    said: dict[str, Any] = json.loads(reply.ok.payload.to_bytes())
    return said


def budgets(robot: Robot, *tasks: str) -> dict[str, int]:
    """The containers' realtime budgets."""
    return {task: budget(group(robot, task)) for task in tasks}


def budgets_above(robot: Robot, task: str) -> list[int]:
    """The realtime budgets of the task's pod, its class and all pods."""
    own = group(robot, task)
    return [budget(above) for above in (own.parent, own.parent.parent, own.parent.parent.parent)]


def budget(of: Path) -> int:
    """A group's realtime budget in thousandths of the period; -1 where the kernel has none."""
    for names in (("cpu.rt_runtime_us", "cpu.rt_period_us"), ("cpu.rt.max",)):
        if (of / names[0]).exists():
            time, period = " ".join((of / name).read_text() for name in names).split()
            return int(time) * 1000 // int(period)
    return -1


def period(of: Path) -> int:
    """The microseconds in which a group's realtime budget is counted."""
    own = of / "cpu.rt_period_us"
    return int((own if own.exists() else of / "cpu.rt.max").read_text().split()[-1])


def policies(robot: Robot, task: str) -> set[tuple[int, int]]:
    """Scheduling policy and priority of each thread of the task's container."""
    own = group(robot, task)
    found = set()
    for thread in (own / ("tasks" if (own / "tasks").exists() else "cgroup.threads")).read_text().split():
        try:
            found.add((os.sched_getscheduler(int(thread)), os.sched_getparam(int(thread)).sched_priority))
        except ProcessLookupError:
            continue
    return found


def usage(robot: Robot, *tasks: str, seconds: float) -> dict[str, float]:
    """Cores that the tasks use, measured."""
    cgroups = {task: robot.container(task) for task in tasks}
    before = {task: cgroup.usage() for task, cgroup in cgroups.items() if cgroup}
    began = time.monotonic()
    time.sleep(seconds)
    elapsed = time.monotonic() - began
    return {task: (cgroup.usage() - before[task]) / elapsed for task, cgroup in cgroups.items() if cgroup}


class Trace:
    """Every change of the tasks' limits, looked at all the time, and every message of the policy, on one clock."""

    def __init__(self, robot: Robot, session: zenoh.Session, *tasks: str) -> None:
        self._cgroups = {task: cgroup for task in tasks if (cgroup := robot.container(task))}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._subscriber = session.declare_subscriber(f"contextpolicy/{robot.namespace}/*/*", self._hear)
        self.limits: list[tuple[float, dict[str, int]]] = []
        self.messages: list[tuple[float, dict[str, Any]]] = []

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._subscriber.undeclare()

    def reached(self, **limits: int) -> float:
        """When the tasks first had these limits; 0 if not yet."""
        return next((at for at, seen in self.limits if seen == limits), 0.0)

    def reported(self, **fields: object) -> float:
        """When a message with these fields was first heard; 0 if not yet."""
        return next((at for at, message in self.messages if fields.items() <= message.items()), 0.0)

    def _hear(self, sample: zenoh.Sample) -> None:
        if payload := sample.payload.to_bytes():
            self.messages.append((time.monotonic(), json.loads(payload)))

    def _look(self) -> None:
        while not self._stop.is_set():
            seen = together(self._cgroups)
            if seen is not None and (not self.limits or seen != self.limits[-1][1]):
                self.limits.append((time.monotonic(), seen))
            time.sleep(0.0002)
