"""Patches of pods/resize as values. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from contextpolicy.policy.quantities import format_cpu

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.cluster.pods import Cpu, PodView


def resize_patch(pod: PodView, wanted: Mapping[str, Cpu]) -> dict[str, Any]:
    """The strategic merge patch for pods/resize; containers merge by name, those not in `wanted` stay as they are.

    The UID keeps it from a pod that has taken the name over.
    """
    lists: dict[str, list[dict[str, Any]]] = {}
    for container in pod.containers:
        cpu = wanted.get(container.name)
        if cpu is not None:
            lists.setdefault(container.list_field, []).append({"name": container.name, "resources": _resources(cpu)})
    return {"metadata": {"uid": pod.uid}, "spec": lists}


def _resources(cpu: Cpu) -> dict[str, dict[str, str]]:
    resources = {}
    if cpu.limit is not None:
        resources["limits"] = {"cpu": format_cpu(cpu.limit)}
    if cpu.request is not None:
        resources["requests"] = {"cpu": format_cpu(cpu.request)}
    return resources
