"""The robot of a simulation: its nodes, and where the tasks' containers run on them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from contextpolicy.planning.allocation.placement import Container, Placement
from contextpolicy.policy.spec import RealtimeFallback, Scheduler

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from contextpolicy.policy.spec import Policy

NODE = "robot"
"""The only node, if no others are given."""
CORES = 4000
"""Thousandths of a core: a Raspberry Pi's."""


@dataclass(frozen=True, slots=True)
class Robot:
    """Nodes with their CPU and tasks with their CPU requests in thousandths of a core.

    A task that `places` does not name runs on the first node; its `replicas` are placed on its nodes in turn.
    """

    nodes: Mapping[str, int] = field(default_factory=lambda: {NODE: CORES})
    places: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    replicas: Mapping[str, int] = field(default_factory=dict)
    requests: Mapping[str, int] = field(default_factory=dict)
    fair_only: frozenset[str] = frozenset()
    """The nodes that can't do realtime."""

    def placement(self, policy: Policy) -> Placement:
        """Where the policy's containers run, without the nodes that `left_alone` names."""
        left_out = frozenset(self.left_alone(policy))
        return Placement(
            {node: cpu for node, cpu in self.nodes.items() if node not in left_out},
            tuple(container for container in self._containers(policy) if container.node not in left_out),
            self.fair_only - left_out if policy.enforcement.scheduler is Scheduler.REALTIME else frozenset(),
        )

    def left_alone(self, policy: Policy) -> list[str]:
        """The nodes that the policy leaves alone: with realtimeFallback None, those that can't do realtime."""
        strict = (
            policy.enforcement.scheduler is Scheduler.REALTIME
            and policy.enforcement.realtime_fallback is RealtimeFallback.NONE
        )
        return sorted(self.fair_only) if strict else []

    def _containers(self, policy: Policy) -> Iterator[Container]:
        first = next(iter(self.nodes))
        for task in policy.leaves:
            nodes = self.places.get(task.name, (first,))
            for index in range(self.replicas.get(task.name, len(nodes))):
                name = task.name if index == 0 else f"{task.name}-{index + 1}"
                yield Container(name, task.name, nodes[index % len(nodes)], self.requests.get(task.name, 0))
