"""A node as the operator sees it."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, NamedTuple

from kubernetes.utils.quantity import parse_quantity

if TYPE_CHECKING:
    from collections.abc import Mapping


PROMPT = (1, 36)
"""Kubernetes since which a kubelet resizes a container within tens of milliseconds."""
SLOW = 2.0
"""Seconds that a kubelet before that may take: it resizes when it looks at the pod the next time."""


class NodeView(NamedTuple):
    """A node: its name, the CPU that its pods may use (thousandths of a core), its kubelet's version as reported.

    One that is not `ready` is switched off, or out of reach.
    """

    name: str
    cpu: int
    kubelet: str = ""
    ready: bool = True

    @property
    def delay(self) -> float:
        """Seconds that its kubelet may take to carry out a resize; next to nothing counts as 0."""
        return 0.0 if kubernetes_version(self.kubelet) >= PROMPT else SLOW


def kubernetes_version(text: str) -> tuple[int, int]:
    """Major and minor of a version such as `v1.36.2+k3s1`; (0, 0) when it has none."""
    found = re.match(r"v?(\d+)\.(\d+)", text)
    return (int(found[1]), int(found[2])) if found else (0, 0)


def read_node(body: Mapping[str, Any]) -> NodeView | None:
    """The node as the API has it; None until its kubelet reports its CPU."""
    cpu = allocatable(body)
    if cpu is None:
        return None
    status = body.get("status") or {}
    said = status.get("nodeInfo") or {}
    ready = all(one.get("status") == "True" for one in status.get("conditions") or () if one.get("type") == "Ready")
    return NodeView(body["metadata"]["name"], cpu, str(said.get("kubeletVersion", "")), ready)


def allocatable(node: Mapping[str, Any]) -> int | None:
    """The CPU that a node's pods may use, in thousandths of a core, rounded down; None until the kubelet reports it."""
    quantity = ((node.get("status") or {}).get("allocatable") or {}).get("cpu")
    try:
        return int(parse_quantity(quantity) * 1000)  # type: ignore[no-untyped-call]
    except (ValueError, ArithmeticError):
        return None
