"""Everything the benchmark needs in the cluster, under names of its own, and its removal."""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Self

from contextpolicy.bus.session import open_visitor
from tests.bench.reaction import objects
from tests.bench.reaction.quiet import BUDGET, Quiet
from tests.e2e.cluster import CommandError, apply, helm_command, run, secret_files
from tests.node.layout import ROOT
from timelines.demo.cgroup import Cgroup, find
from timelines.demo.deploy import free_address

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    import zenoh

    from tests.bench.reaction.stopwatch import Stopwatch

PLAIN = "bench-resize"
AGENT = "bench-agent"
SPARE = "bench-spare"
LOAD = "bench-load"
ADDRESSES = {PLAIN: 149, AGENT: 150}
LOADS = 4


class Site:
    """Namespaces, operators and pods: what was asked for exists, and all of it is gone at the end."""

    def __init__(self, stopwatch: Stopwatch, patience: float = BUDGET) -> None:
        self._stopwatch = stopwatch
        self._end = ExitStack()
        self.quiet = Quiet(patience)
        self.groups: dict[str, dict[str, Cgroup]] = {}
        self.identities: dict[str, dict[str, str]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        say("cleaning up")
        self._end.close()

    def pods(self, namespace: str, names: Iterable[str]) -> None:
        """Idle pods, their limits watched."""
        self._namespace(namespace)
        known = self.groups[namespace]
        self._start(namespace, [objects.idle_pod(name, namespace) for name in names if name not in known])

    def workers(self, namespace: str, wanted: Mapping[str, tuple[int, float]]) -> None:
        """Pods that work on request, with their number of processes and how much of a core each of these wants."""
        self._namespace(namespace)
        known = self.groups[namespace]
        new = {name: settings for name, settings in wanted.items() if name not in known}
        self._start(namespace, [objects.worker_pod(name, namespace, *settings) for name, settings in new.items()])

    def module(self, namespace: str, pod: dict[str, Any]) -> None:
        """One pod as it is."""
        self._namespace(namespace)
        self._start(namespace, [pod])

    def replicated(self, namespace: str, pods: list[dict[str, Any]]) -> None:
        """Each of these pods under a controller, which gives it another name; it is known by its own."""
        self._namespace(namespace)
        say(f"{len(pods)} controllers in {namespace}")
        apply(*map(objects.replicated, pods))
        for name in (pod["metadata"]["name"] for pod in pods):
            run("kubectl", "rollout", "status", f"statefulset/{name}", "-n", namespace, "--timeout=120s", timeout=150)
            self._know(
                namespace, name, json.loads(run("kubectl", "get", "pod", f"{name}-0", "-n", namespace, "-o", "json"))
            )

    def counter(self, namespace: str, name: str) -> None:
        """A pod that counts what it computes, on request."""
        self._namespace(namespace)
        if name not in self.groups[namespace]:
            self._start(namespace, [objects.counting_pod(name, namespace)])

    def load(self) -> None:
        """Pods that can saturate the node."""
        self.workers(LOAD, {f"load-{number}": (1, 1.0) for number in range(LOADS)})

    def operator(self, namespace: str, *, agent: bool = False) -> zenoh.Session:
        """An operator and router, of a request of 100m, that watch this namespace only; a session on its bus."""
        self._namespace(namespace)
        address = free_address(ADDRESSES[namespace])
        values = {
            "fullnameOverride": namespace,
            "image.repository": "contextpolicy",
            "image.tag": "dev",
            "router.service.clusterIP": address,
            "watchNamespaces": f"{{{namespace}}}",
            "agent.enabled": str(agent).lower(),
            "security.enabled": str(agent).lower(),
            "agent.podLogs": str(ROOT / "pods"),
        }
        self._end.callback(_quietly, "helm", "uninstall", namespace, "-n", namespace, "--wait", "--timeout", "60s")
        run(*helm_command(namespace, namespace, values), timeout=150)
        self._end.callback(_quietly, "kubectl", "delete", "ctxp", "--all", "-n", namespace, "--timeout=60s")
        if not agent:
            return self._end.enter_context(open_visitor([f"tcp/{address}:7447"], patience=20))
        directory = Path(self._end.enter_context(TemporaryDirectory()))
        credentials = secret_files(f"{namespace}-bus-module", namespace, directory)
        return self._end.enter_context(open_visitor([f"tls/{address}:7447"], patience=20, credentials=credentials))

    def govern(self, namespace: str, names: list[str]) -> dict[str, Cgroup]:
        """Apply the policy for these pods; their cgroups by container id."""
        reserve = f"{round((allocatable() - 1) * 1000)}m"
        apply(objects.policy(namespace, names, reserve))
        return {self.identities[namespace][name]: self.groups[namespace][name] for name in names}

    def saturate(self, *, on: bool) -> None:
        """Let the load work, or rest."""
        self.signal(LOAD, self.groups[LOAD], on=on)
        time.sleep(1.0 if on else 2.0)

    def signal(self, namespace: str, names: Iterable[str], *, on: bool) -> None:
        """Make workers work, or rest."""
        for name in names:
            for pid in self.groups[namespace][name].processes():
                os.kill(pid, signal.SIGUSR1 if on else signal.SIGUSR2)

    def _namespace(self, name: str) -> None:
        if name not in self.groups:
            self.groups[name], self.identities[name] = {}, {}
            self._end.callback(_quietly, "kubectl", "delete", "namespace", name, "--ignore-not-found", "--timeout=120s")
            apply({"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": name}})

    def _start(self, namespace: str, pods: list[dict[str, Any]]) -> None:
        if not pods:
            return
        say(f"{len(pods)} pods in {namespace}")
        apply(*pods)
        names = [pod["metadata"]["name"] for pod in pods]
        run(
            *("kubectl", "wait", *(f"pod/{name}" for name in names), "-n", namespace),
            *("--for=condition=Ready", "--timeout=180s"),
            timeout=200,
        )
        for pod in json.loads(run("kubectl", "get", "pods", "-n", namespace, "-o", "json"))["items"]:
            if pod["metadata"]["name"] in names:
                self._know(namespace, pod["metadata"]["name"], pod)

    def _know(self, namespace: str, name: str, pod: dict[str, Any]) -> None:
        identity = pod["status"]["containerStatuses"][0]["containerID"]
        group = find(identity)
        if group is None:
            raise CommandError(f"no cgroup of {identity}: the benchmark has to run on the node itself")
        self.groups[namespace][name], self.identities[namespace][name] = group, identity
        self._stopwatch.watch(group)


def allocatable() -> float:
    """The node's CPUs that pods may have."""
    node = json.loads(run("kubectl", "get", "nodes", "-o", "json"))["items"][0]
    cpu = str(node["status"]["allocatable"]["cpu"])
    return int(cpu[:-1]) / 1000 if cpu.endswith("m") else float(cpu)


def say(what: str) -> None:
    """Progress goes to stderr."""
    print(f"{time.strftime('%H:%M:%S')} {what}", file=sys.stderr, flush=True)  # noqa: T201


def _quietly(*argv: str) -> None:
    """A step of the removal that fails must not keep the others from being taken."""
    try:
        run(*argv, timeout=150)
    except CommandError as error:
        say(str(error).strip())
