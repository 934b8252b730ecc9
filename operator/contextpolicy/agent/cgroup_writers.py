"""What writes the pods' cgroups, once the kubelet has created them: CPU limits, weights and realtime budgets."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.agent import weight_units
from contextpolicy.agent.cgroup_paths import pod_of
from contextpolicy.agent.control_files import CFS, REALTIME, ControlFiles
from contextpolicy.agent.cpu_weights import Weights
from contextpolicy.agent.limits import Limits
from contextpolicy.agent.open_files import Unwatched
from contextpolicy.agent.realtime import Realtime
from contextpolicy.planning.allocation.placement import QUANTUM
from contextpolicy.policy.spec import Scheduler

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping
    from pathlib import Path

    from contextpolicy.agent.cgroup_paths import CgroupPaths
    from contextpolicy.agent.failures import Failures
    from contextpolicy.agent.ledger import Ledger
    from contextpolicy.agent.node_orders import NodeOrder, OrderTarget
    from contextpolicy.agent.open_files import FileWatch

_MOST_GROUPS = 1000
"""Containers whose cgroups are remembered; a node has a tenth of that, and it may run for years."""


class CgroupWriters:
    """One node's writers. Nothing is raised: each method returns the groups where it failed."""

    def __init__(
        self, layout: CgroupPaths, ledger: Ledger, watch: FileWatch, priority: int, processors: Callable[[], int]
    ) -> None:
        self.layout, self._processors = layout, processors
        self._limits = Limits(ControlFiles(CFS[layout.version], watch), ledger)
        self._weights = Weights(layout.version, watch, ledger)
        self._realtime = Realtime(layout, ControlFiles(REALTIME[layout.version], Unwatched()), ledger, priority)
        self._groups: dict[tuple[str, str, str], Path] = {}

    def group(self, target: OrderTarget) -> Path | None:
        """The target's cgroup; None when there is none. One whose limit we have open needs no look."""
        name = target.qos, target.uid, target.container_id
        group = self._groups.get(name)
        if group is not None and (self._limits.knows(group) or self._weights.knows(group)):
            return group
        if len(self._groups) >= _MOST_GROUPS:
            self._groups.clear()
        group = self.layout.container(*name)
        if not (target.container_id and group.is_dir()):
            return None
        self._groups[name] = group
        return group

    def name(self, group: Path) -> str:
        """The ID of a container that a plan named; the group's own name where none is remembered."""
        return next((name[2] for name, known in self._groups.items() if known == group), group.name)

    def apply(
        self, order: NodeOrder, groups: Mapping[Path, OrderTarget], draining: Collection[Path], *, again: bool
    ) -> Failures:
        """Carry out the order on these groups, and undo what else the policy had; those `draining` keep their quota.

        `again`: it is no new plan, and what an owner wrote since the first time stays.
        """
        if order.scheduler is Scheduler.REALTIME:
            return self._apply_realtime(order, groups, again=again)
        # Settled first: `apply` makes an earlier run's entries its own, as if no resize had confirmed them yet.
        for group, target in groups.items():
            if target.limit is not None:
                self._limits.settle(group, target.limit)
        # A Guaranteed pod is beside the classes: a weight there would compete with all of them.
        weighted = {group: target for group, target in groups.items() if target.qos == "Burstable"}
        weights = {group: target.weight for group, target in weighted.items() if target.weight is not None}
        requests = {group: target.request for group, target in weighted.items() if target.request is not None}
        failures = self._weights.apply(order.policy, weights, requests)
        quotas = {group: target.quota for group, target in groups.items() if group not in draining}
        quotas |= self._limits.standing(order.policy, draining)
        held, owned = {group for group in _held(groups) if group not in draining}, _owned(groups)
        failures |= self._limits.apply(order.policy, quotas, held, _originals(groups), owned=owned, again=again)
        return self._realtime.release(order.policy) | failures

    def release(self, policy: str, *, leave_agreed: bool = False) -> Failures:
        """Undo everything for the policy; `leave_agreed`: but for what the API has as well."""
        limits = self._limits.release(policy, leave_agreed=leave_agreed)
        return self._weights.release(policy) | limits | self._realtime.release(policy)

    def on_other_write(self, path: Path, heard: float) -> Failures:
        """Another process wrote a file that we watch, as we `heard` then, in seconds on the monotonic clock."""
        weight = path.name == weight_units.FILES[self.layout.version]
        return (self._weights if weight else self._limits).on_other_write(path, heard)

    def _apply_realtime(self, order: NodeOrder, groups: Mapping[Path, OrderTarget], *, again: bool) -> Failures:
        # Limits first: they must be in force when suspended threads fall back to the fair scheduler.
        resting = {group: target.quota or QUANTUM for group, target in groups.items() if target.suspended}
        originals, owned = _originals(groups), _owned(groups)
        failures = self._limits.apply(order.policy, resting, resting, originals, owned=owned, again=again)
        failures |= self._weights.release(order.policy)
        processors = self._processors()
        parts = {group: target.part(processors) for group, target in groups.items()}
        return self._realtime.apply(order.policy, parts, order.manner, resting) | failures


def _held(groups: Mapping[Path, OrderTarget]) -> set[Path]:
    return {group for group, target in groups.items() if target.held}


def _owned(groups: Mapping[Path, OrderTarget]) -> set[Path]:
    return {pod_of(group) for group, target in groups.items() if target.pod_limit is not None}


def _originals(groups: Mapping[Path, OrderTarget]) -> dict[Path, int | None]:
    return {group: target.original for group, target in groups.items()}
