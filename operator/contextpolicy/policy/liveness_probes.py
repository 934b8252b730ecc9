"""Liveness probes of tasks that may be suspended: the kubelet kills a container that answers too late. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.policy.dependencies import suspendable
from contextpolicy.policy.quantities import format_cpu

if TYPE_CHECKING:
    from contextpolicy.policy.spec import Policy, Task

TOO_LITTLE = 10
"""Thousandths of a core that a suspended container keeps by default."""


class ProbeWarning(NamedTuple):
    """What may go wrong, and what to do about it."""

    seen: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.seen}; {self.remedy}"


def probe_warning(policy: Policy, task: Task, container: str) -> ProbeWarning | None:
    """Why the kubelet may restart a container with a probe while its task is suspended; None when it can't be."""
    if task.suspended_cpu > TOO_LITTLE or not suspendable(policy, task):
        return None
    return ProbeWarning(
        f"{container} has a livenessProbe and only {format_cpu(TOO_LITTLE)} while it is suspended: if it answers too "
        "late, the kubelet restarts it",
        "set suspendedCpu of the task, 50m for example, or a longer timeoutSeconds of the probe",
    )
