"""The cgroups that an order is about."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from contextpolicy.agent.cgroup_writers import CgroupWriters
    from contextpolicy.agent.node_orders import NodeOrder, OrderTarget
    from contextpolicy.agent.pod_namespaces import PodNamespaces
    from contextpolicy.agent.refusals import Refusals


class TargetGroups:
    """Finds the cgroups of an order's targets; refuses those that this node lacks, and those of foreign namespaces."""

    def __init__(self, namespaces: PodNamespaces, refusals: Refusals) -> None:
        self._namespaces, self._refusals = namespaces, refusals

    def find(self, writers: CgroupWriters, order: NodeOrder) -> tuple[dict[Path, OrderTarget], dict[str, str]]:
        """The cgroups of the targets on this node, and why the other containers have none.

        A path of the pod's UID and the container's ID must exist; until a container starts it has no ID. Containers
        outside the policy's own namespace are refused, even in a signed plan.
        """
        groups, refused = {}, {}
        for target in order.targets:
            group = writers.group(target)
            if group is None:
                container = target.container_id or "a starting container"
                self._refusals.note("NotHere", f"{order.policy}: no cgroup on this node for {container}")
                refused[target.container_id] = "NotHere"
            elif (namespace := self._namespaces.of(target.uid)) != order.namespace:
                found = f"container {target.container_id} belongs to namespace {namespace}"
                self._refusals.note("Foreign", f"{order.policy}: {found}, not {order.namespace}")
                refused[target.container_id] = "Foreign"
            else:
                groups[group] = target
        refused.pop("", None)
        return groups, refused
