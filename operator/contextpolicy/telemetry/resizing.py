"""How resizing goes: stage times for the metrics, problems for status and events."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from contextpolicy.telemetry import metrics

if TYPE_CHECKING:
    from collections.abc import Callable

    from contextpolicy.cluster.pods import Cpu, PodView
    from contextpolicy.errors import ActuationError


class ResizeWatch:
    """Hears of every patch.

    `on_problem(policy, reason, message)` is called once per new problem and when one ends, `on_stage(policy, stage,
    container, cores, at)` when the API accepted a limit (`accepted`) and when the node has it (`inForce`). Times are
    monotonic.
    """

    def __init__(
        self, on_problem: Callable[[str, str, str], None], on_stage: Callable[[str, str, str, float, float], None]
    ) -> None:
        self._on_problem, self._on_stage = on_problem, on_stage
        self._arrived: dict[str, float] = {}
        self._failed: dict[str, dict[str, str]] = {}
        self._pending: dict[str, str] = {}
        self._pods: dict[str, set[str]] = {}

    def planned(self, policy: str, arrived: float) -> None:
        """A plan was made from a sample that arrived then."""
        self._arrived[policy] = arrived
        self._observe(policy, "plan", time.monotonic())

    def on_accepted(self, policy: str, container: str, cpu: Cpu, answered: float) -> None:
        """The API has the new resources."""
        self._on_stage(policy, "accepted", container, (cpu.limit or 0) / 1000, answered)
        self._pods.setdefault(policy, set()).add(container.rsplit("/", 1)[0])
        metrics.RESIZES.labels(policy, "accepted").inc()
        self._observe(policy, "patch", answered)

    def on_in_force(self, policy: str, container: str, limit: int) -> None:
        """The kubelet reports the limit that the plan wants."""
        now = time.monotonic()
        self._on_stage(policy, "inForce", container, limit / 1000, now)
        self._observe(policy, "status", now)

    def on_problem(self, policy: str, pod: str, error: ActuationError | None) -> None:
        """A patch failed, or after a failure works again."""
        failed = self._failed.setdefault(policy, {})
        if error is None:
            if failed.pop(pod, None):
                self._on_problem(policy, "ResizeRecovered", f"{pod} can be resized again")
            return
        metrics.RESIZES.labels(policy, error.reason).inc()
        message = f"{pod}: {error.reason}: {error}"
        if failed.get(pod) != message:
            failed[pod] = message
            self._on_problem(policy, "ResizeFailed", message)

    def observe(self, pod: PodView) -> None:
        """Take what the kubelet says about resizes that it holds back."""
        identity = f"{pod.namespace}/{pod.name}"
        if self._pending.get(identity, "") == pod.pending:
            return
        self._pending[identity] = pod.pending
        for policy, pods in self._pods.items():
            if identity in pods and pod.pending:
                self._on_problem(policy, "ResizePending", f"{pod.name}: {pod.pending}")

    def lose(self, pod: PodView) -> None:
        """The pod is gone, and its problems with it."""
        identity = f"{pod.namespace}/{pod.name}"
        self._pending.pop(identity, None)
        for pods in self._pods.values():
            pods.discard(identity)
        for policy, failed in self._failed.items():
            if policy.partition("/")[0] == pod.namespace:
                failed.pop(pod.name, None)

    def problems(self, policy: str) -> dict[str, str]:
        """What can't be applied now, by pod."""
        held = {pod: f"{pod}: {self._pending[pod]}" for pod in self._pods.get(policy, ()) if self._pending.get(pod)}
        return self._failed.get(policy, {}) | held

    def forget(self, policy: str) -> None:
        """The policy is gone."""
        for known in (self._arrived, self._failed, self._pods):
            known.pop(policy, None)

    def _observe(self, policy: str, stage: str, at: float) -> None:
        arrived = self._arrived.get(policy)
        if arrived:
            metrics.STAGE_SECONDS.labels(policy, stage).observe(at - arrived)
