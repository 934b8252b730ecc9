"""The operator's runtime on a real session, with a cluster in memory that takes a real cluster's time."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from threading import Lock
from typing import TYPE_CHECKING, Any

from contextpolicy.actuators.resize.stored_originals import UnsignedOriginals
from contextpolicy.app.wiring import Operator
from contextpolicy.bus.signatures import UnsignedPlans
from contextpolicy.policy.tenants import Tenants
from contextpolicy.streams.loop import Loop
from contextpolicy.streams.wall_clock import WallClock
from tests.cluster.builders import NODE, a_pod
from tests.policies.builders import resources
from tests.virtual_operator import ClusterWithPolicies, OpenFence

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    import zenoh

    from contextpolicy.bus.signatures import PlanSigner

PATCH, KUBELET = 0.01, 0.01
"""Seconds until the API accepts a limit, and from then until it is in force and reported."""
TASKS = ("slam", "speech")
WORKERS = 8


class StandInCluster(ClusterWithPolicies):
    """Accepts a patch, puts it in force, notifies the watch; `in_force` is when each limit last began."""

    def __init__(self, pods: Iterable[dict[str, Any]]) -> None:
        super().__init__(*pods)
        self.in_force: dict[tuple[str, int], float] = {}
        self.notify: Callable[[Mapping[str, Any]], None] = lambda _: None
        self._lock = Lock()
        self._kubelet = ThreadPoolExecutor(WORKERS)

    def resize(self, namespace: str, name: str, patch: Mapping[str, Any], manager: str) -> int:
        time.sleep(PATCH)
        with self._lock:
            version = super().resize(namespace, name, patch, manager)
            self.calls.clear()
        self._kubelet.submit(self._put_in_force, f"uid-{name}")
        return version

    def write_originals(self, namespace: str, policy: str, changes: Mapping[str, Any]) -> int:
        with self._lock:
            return super().write_originals(namespace, policy, changes)

    def _put_in_force(self, uid: str) -> None:
        time.sleep(KUBELET)
        with self._lock:
            self.confirm(uid)
            self.in_force |= {limit: time.monotonic() for limit in self.limits(uid).items()}
            news = list(self.feeds[uid])
            self.feeds[uid].clear()
        for pod in news:
            self.notify(pod)


class LiveOperator:
    """An operator that governs its robot by one policy."""

    def __init__(
        self,
        session: zenoh.Session,
        body: dict[str, Any],
        cluster: StandInCluster | None = None,
        signer: PlanSigner | None = None,
    ) -> None:
        self.cluster = cluster or StandInCluster(a_pod(name, {name: resources()}) for name in TASKS)
        self.cluster.policies[f"{body['metadata']['namespace']}/{body['metadata']['name']}"] = {}
        patches, reports = ThreadPoolExecutor(WORKERS), ThreadPoolExecutor(1)
        loop = Loop()
        self._operator = Operator(
            self.cluster,
            OpenFence(),
            loop,
            patches=patches,
            reports=reports,
            signer=signer or UnsignedPlans(),
            signatures=UnsignedOriginals(),
            tenants=Tenants(),
            clock=WallClock(loop),
        )
        self.cluster.notify = self._operator.pod_changed
        self._operator.node_changed({"metadata": {"name": NODE, "uid": NODE}, "status": {"allocatable": {"cpu": "1"}}})
        for feed in self.cluster.feeds.values():
            feed.clear()
        for pod in self.cluster.pods.values():
            self._operator.pod_changed(pod)
        self._operator.connected(session)
        self._operator.policy_changed(body).result(timeout=5.0)
