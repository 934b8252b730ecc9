"""Patches of pods/resize as values: the CPU that a share means for a container, and the patch that sets it. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from contextpolicy.cluster.pods import Cpu
from contextpolicy.policy.quantities import format_cpu
from contextpolicy.policy.spec import Control

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.cluster.pods import ContainerView, PodView

MIN_SHARES_REQUEST = 2
"""The kubelet's smallest cpu.shares is 2, a request of 2m."""


def cpu_for(pod: PodView, container: ContainerView, share: int, control: Control, ceiling: int) -> Cpu:
    """The request and limit that give a container its `share`; `ceiling` is its limit where only weights move.

    A Guaranteed pod keeps its class: request and limit stay equal.
    """
    if pod.qos == "Guaranteed":
        return Cpu(share, share)
    request = container.spec.request
    if control is Control.LIMIT:
        return Cpu(request, share)
    limit = ceiling if control is Control.WEIGHT else share
    # A request equal to the limit could turn the pod Guaranteed, and a resize may not change the QoS class.
    below = share - 1 if share == limit else share
    return Cpu(max(MIN_SHARES_REQUEST, below), limit)


def resize_patch(pod: PodView, wanted: Mapping[str, Cpu]) -> dict[str, Any]:
    """The strategic merge patch for pods/resize; containers merge by name, those not in `wanted` stay as they are."""
    lists: dict[str, list[dict[str, Any]]] = {}
    for container in pod.containers:
        cpu = wanted.get(container.name)
        if cpu is not None:
            lists.setdefault(container.list_field, []).append({"name": container.name, "resources": _resources(cpu)})
    return {"spec": lists}


def _resources(cpu: Cpu) -> dict[str, dict[str, str]]:
    resources = {}
    if cpu.limit is not None:
        resources["limits"] = {"cpu": format_cpu(cpu.limit)}
    if cpu.request is not None:
        resources["requests"] = {"cpu": format_cpu(cpu.request)}
    return resources
