"""A bare PATCH of pods/resize, without an operator: what Kubernetes itself takes, as a request and as a command."""

from __future__ import annotations

import json
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import cycle
from typing import TYPE_CHECKING

from kubernetes import client, config

from tests.e2e.cluster import run

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tests.bench.reaction.stopwatch import Stopwatch
    from timelines.demo.cgroup import Cgroup

CORES = (0.1, 0.2, 0.3)
CONNECTIONS = 8
PATIENCE = 5.0


class BarePatch:
    """Moves the limits of some pods at once, over connections that are kept open."""

    def __init__(self, namespace: str, groups: Mapping[str, Cgroup], stopwatch: Stopwatch) -> None:
        self._groups, self._stopwatch = groups, stopwatch
        config.load_kube_config()
        settings = client.Configuration.get_default_copy()
        settings.connection_pool_maxsize = CONNECTIONS
        self._client = client.ApiClient(settings)
        self._requests = {pod: self._prepare(namespace, pod) for pod in groups}
        self._threads = ThreadPoolExecutor(CONNECTIONS, thread_name_prefix="bare")
        self._cores = cycle(CORES)
        self.name = "bare PATCH" if len(groups) == 1 else "bare PATCHes at once"

    def go(self) -> dict[str, float]:
        """Milliseconds to each stage."""
        cores = self._next()
        began = time.time()
        accepted = self.send(dict.fromkeys(self._groups, cores))
        seen = self._stopwatch.wait(dict.fromkeys(self._groups.values(), cores), began, PATIENCE)
        moments = {
            "first patch accepted": min(accepted),
            "first cgroup": min(seen.values()),
            "all cgroups": max(seen.values()),
        }
        return {stage: (at - began) * 1e3 for stage, at in moments.items()}

    def pair(self, apart: float) -> float:
        """Milliseconds until the second of two changes, so many seconds apart, is in force."""
        began = time.time()
        self.send(dict.fromkeys(self._groups, self._next()))
        time.sleep(max(0.0, began + apart - time.time()))
        return self.go()["all cgroups"]

    def send(self, wanted: Mapping[str, float]) -> list[float]:
        """Send all of these, in order, as fast as the connections take them; when the API accepted each."""
        return list(self._threads.map(self._send, wanted, wanted.values()))

    def close(self) -> None:
        """Give the connections back."""
        self._threads.shutdown()
        self._client.rest_client.pool_manager.clear()

    def _next(self) -> float:
        """A limit that no pod has, nor is about to get."""
        now = {group.limit() for group in self._groups.values()}
        return next(cores for cores in self._cores if cores not in now)

    def _prepare(self, namespace: str, pod: str) -> tuple[str, str, dict[str, str]]:
        """All of a request but its body, so that the client's own work is not measured."""
        method, url, headers, *_ = self._client.param_serialize(
            method="PATCH",
            resource_path=f"/api/v1/namespaces/{namespace}/pods/{pod}/resize",
            header_params={"Accept": "application/json", "Content-Type": "application/strategic-merge-patch+json"},
            auth_settings=["BearerToken"],
        )
        return method, url, headers

    def _send(self, pod: str, cores: float) -> float:
        method, url, headers = self._requests[pod]
        body = _body(pod, cores)
        answer = self._client.rest_client.pool_manager.request(method, url, body=body, headers=headers)
        at = time.time()
        if answer.status != 200:
            raise RuntimeError(f"PATCH of {pod}: HTTP {answer.status}: {answer.data[:300]!r}")
        return at


class KubectlPatch:
    """`kubectl patch --subresource=resize`, as a person would; its start is part of the time."""

    name = "kubectl patch"

    def __init__(self, namespace: str, pod: str, group: Cgroup, stopwatch: Stopwatch) -> None:
        self._namespace, self._pod, self._group, self._stopwatch = namespace, pod, group, stopwatch
        self._next = cycle(CORES)

    def go(self) -> dict[str, float]:
        """Milliseconds to each stage."""
        cores = next(self._next)
        began = time.time()
        change = ("--subresource=resize", "--patch", _body(self._pod, cores))
        run("kubectl", "patch", "pod", self._pod, "-n", self._namespace, *change)
        seen = self._stopwatch.wait({self._group: cores}, began, PATIENCE)
        return {"cgroup": (seen[self._group] - began) * 1e3}

    def close(self) -> None:
        """There is nothing to let go of."""


def _body(pod: str, cores: float) -> str:
    resources = {"limits": {"cpu": f"{round(cores * 1000)}m"}}
    return json.dumps({"spec": {"containers": [{"name": pod, "resources": resources}]}})
