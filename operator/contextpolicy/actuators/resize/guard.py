"""Detect that another client has resized a container of a policy. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.actuators.resize.conflict import Conflict, Ownership
from contextpolicy.cluster.pods import Cpu
from contextpolicy.cluster.writers import OURS

if TYPE_CHECKING:
    from contextpolicy.actuators.resize.originals import Original
    from contextpolicy.actuators.resize.targets import Target
    from contextpolicy.cluster.pods import ContainerView


def look(policy: str, target: Target, now: float) -> Conflict | None:
    """Compare what a container has with what its policy last gave it; returns a foreign change when it is new."""
    pod, container = target.pod, target.container
    spec = target.spec
    # While a patch is under way, the watch may already show its effect.
    if pod.state.patch is not None or spec is None:
        return None
    ownership = pod.owned.get(container.name)
    if ownership is None:
        written = spec != container.spec  # by us just now: the watch does not show it yet
        had = spec if written else _last_given(container, target.original)
        # We never resized it, so no other client can have changed it yet.
        if had is None and spec != target.cpu:
            return None
        ownership = pod.owned[container.name] = Ownership(policy, had or spec)
    if spec in (target.cpu, ownership.cpu):
        ownership.give(policy, spec)
    elif ownership.compare(spec, now):
        ownership.reported = True
        by = container.writers.limit if spec.limit != ownership.cpu.limit else container.writers.request
        return Conflict(by, ownership.cpu, spec, ownership.yielded)
    return None


def _last_given(container: ContainerView, original: Original | None) -> Cpu | None:
    """What an earlier run of the operator last gave it; for a field that others have written since, the original."""
    if original is None:
        return None
    ours, spec = ("", *OURS), container.spec
    return Cpu(
        spec.request if container.writers.request in ours else original.cpu.request,
        spec.limit if container.writers.limit in ours else original.cpu.limit,
    )
