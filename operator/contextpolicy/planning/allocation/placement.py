"""Where the tasks' containers run, as far as planning needs to know."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

QUANTUM = 10
"""CPU limits move in steps of 10m: the kubelet's smallest quota, and what the systemd driver rounds to."""


@dataclass(frozen=True, slots=True)
class Container:
    """One container that a task claims.

    `request` is its CPU request in thousandths of a core, below which the API lets no limit go; `memory` is its memory
    limit in bytes and `limit` the CPU limit that it had before any policy, None if it has none.
    `weighted`: its pod is Burstable, so it has a weight of its own; a Guaranteed pod's request must equal its limit.
    `left` is a limit that another writer insists on, and that is left in place; no plan depends on it.
    """

    id: str
    task: str
    node: str
    request: int = 0
    memory: int | None = None
    limit: int | None = None
    weighted: bool = True
    left: int | None = field(default=None, compare=False)

    @property
    def floor(self) -> int:
        """The lowest limit that the API accepts, in thousandths of a core, a multiple of the quantum."""
        return max(QUANTUM, -(-self.request // QUANTUM) * QUANTUM)


@dataclass(frozen=True, slots=True)
class Placement:
    """Allocatable CPU of each node in thousandths of a core, and the containers on them.

    Nodes in `fair_only` can't do realtime: they divide as under CFS, whatever the policy's scheduler. `absent` are the
    tasks that run nowhere; that can't be read off `containers`, which leaves out running but ungoverned ones.
    """

    allocatable: Mapping[str, int] = field(default_factory=dict)
    containers: tuple[Container, ...] = ()
    fair_only: frozenset[str] = frozenset()
    absent: frozenset[str] = frozenset()
    processors: Mapping[str, int] = field(default_factory=dict)
    """As counted by the nodes' agents; without an agent, as many as the allocatable CPU needs."""
    quota_periods: Mapping[str, float] = field(default_factory=dict)
    """The kubelets' CFS periods in seconds, as the nodes' agents found them."""
    agents: frozenset[str] = frozenset()
    """The nodes whose agents write quotas: there a request holds none up."""
    left: Mapping[str, int] = field(default_factory=dict)
    """What other policies leave of a node, in thousandths of a core; a node not named is all there."""

    def processors_of(self, node: str) -> int:
        """Over how many processors a realtime budget is spread."""
        return self.processors.get(node) or max(1, -(-self.allocatable[node] // 1000))

    def by_node(self) -> dict[str, dict[str, list[Container]]]:
        """Node -> task -> containers, in a stable order; only nodes whose size is known."""
        nodes: dict[str, dict[str, list[Container]]] = defaultdict(lambda: defaultdict(list))
        for container in sorted(self.containers, key=lambda c: c.id):
            if container.node in self.allocatable:
                nodes[container.node][container.task].append(container)
        return nodes
