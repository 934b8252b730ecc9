"""A node whose agent is gone: its containers' limits are written once more, although the API has them already.

The agent, or its supervisor, may have undone what the API has, and a frozen agent may have left what no plan wants any
more. Nobody reports either. A kubelet writes a container's request and limit, and its pod's, when one of them changes
(`doPodResizeAction` in kubelet/kuberuntime/kuberuntime_manager.go): so the request is asked for off by a thousandth of
a core, and then right. No limit moves, so nothing has to make room.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.cluster.pods import Cpu
from contextpolicy.planning.allocation.placement import QUANTUM

if TYPE_CHECKING:
    from contextpolicy.cluster.pods import ContainerView, PodView

LEAST_REQUEST = 2
"""Thousandths of a core: the kubelet's smallest cpu.shares is 2."""

REWRITE_AFTER = 15.0
"""Seconds after the takeover. A killed agent's supervisor undoes what it left 10 s after its death, the operator takes
over no sooner: what is written at once might be undone at once."""


def can_rewrite(container: ContainerView) -> bool:
    """Whether a resize writes the container's limit, and does not restart it."""
    return container.spec.limit is not None and container.spec.request is not None and not container.restarts


def aside(qos: str, wanted: Cpu) -> Cpu:
    """The wanted resources, off by the least that a kubelet acts on. The pod keeps its class."""
    request, limit = wanted.request or 0, wanted.limit or 0
    if qos == "Guaranteed":
        near = limit - 1 if limit > QUANTUM else limit + 1  # kubelets take all below 10m for 10m
        return Cpu(near, near)
    return Cpu(request - 1 if request > LEAST_REQUEST else request + 1, wanted.limit)


def has_taken(pod: PodView, container: ContainerView) -> bool:
    """Whether the kubelet has acted on the container's newest resources, or reports that it can't for now."""
    return pod.seen and (bool(pod.pending) or (container.granted and not pod.resizing))
