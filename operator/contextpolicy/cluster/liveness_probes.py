"""Liveness probes of tasks that may be suspended: the kubelet kills a container that answers too late. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.planning.allocation.placement import QUANTUM
from contextpolicy.policy.dependencies import suspendable
from contextpolicy.policy.quantities import format_cpu

if TYPE_CHECKING:
    from contextpolicy.cluster.pods import ContainerView, PodView
    from contextpolicy.policy.spec import Policy, Task


class ProbeWarning(NamedTuple):
    """What may go wrong, and what to do about it."""

    seen: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.seen}; {self.remedy}"


def probe_warning(policy: Policy, task: Task, pod: PodView, container: ContainerView) -> ProbeWarning | None:
    """Why the kubelet may restart the container while its task is suspended; None when it can't be for that."""
    if not container.probed or task.suspended_cpu > QUANTUM or not suspendable(policy, task):
        return None
    return ProbeWarning(
        f"{pod.name}/{container.name} has a livenessProbe and only {format_cpu(QUANTUM)} while it is suspended: if it "
        "answers too late, the kubelet restarts it",
        "set suspendedCpu of the task, 50m for example, or a longer timeoutSeconds of the probe",
    )
