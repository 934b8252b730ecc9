"""One node's agent: turns orders into cgroup writes; everything here runs on the loop's thread."""

from __future__ import annotations

import logging
import os
import time
from typing import TYPE_CHECKING, Any

from contextpolicy.agent import capabilities
from contextpolicy.agent import node_orders as orders
from contextpolicy.agent.admission import Admission
from contextpolicy.agent.cgroup_paths import find_cgroups
from contextpolicy.agent.control_files import CFS, REALTIME, ControlFiles
from contextpolicy.agent.ledger import Ledger
from contextpolicy.agent.limits import Limits
from contextpolicy.agent.pod_namespaces import PodNamespaces
from contextpolicy.agent.realtime import Realtime
from contextpolicy.agent.refusals import Refusals
from contextpolicy.agent.service import OBEYED_SECONDS
from contextpolicy.agent.usage import usage
from contextpolicy.errors import ActuationError, OrderError
from contextpolicy.planning.allocation.placement import QUANTUM
from contextpolicy.policy.spec import Mode, Scheduler

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from reactivex.abc import DisposableBase, SchedulerBase

    from contextpolicy.agent.agent_settings import AgentSettings
    from contextpolicy.agent.cgroup_paths import CgroupPaths
    from contextpolicy.agent.inotify import WriteWatch
    from contextpolicy.agent.node_orders import NodeOrder, OrderTarget
    from contextpolicy.cluster.agent_reports import Stamp

log = logging.getLogger(__name__)

_ATTEMPTS = 3
_MOST_GROUPS = 1000
"""Containers whose cgroups are remembered; a node has a tenth of that, and it may run for years."""


class _CgroupWriters:
    """What writes the pods' cgroups, once the kubelet has created them: CPU limits and realtime budgets."""

    def __init__(
        self, layout: CgroupPaths, ledger: Ledger, refusals: Refusals, watch: WriteWatch, priority: int
    ) -> None:
        limits = ControlFiles(CFS[layout.version], watch.add, watch.remove)
        budgets = ControlFiles(REALTIME[layout.version])
        self.layout = layout
        self.limits = Limits(limits, ledger, refusals)
        self.realtime = Realtime(layout, budgets, ledger, refusals, priority)
        self._groups: dict[tuple[str, str, str], Path] = {}

    def group(self, target: OrderTarget) -> Path | None:
        """The target's cgroup; None when there is none. One whose limit we have open needs no look."""
        name = target.qos, target.uid, target.container_id
        group = self._groups.get(name)
        if group is not None and self.limits.knows(group):
            return group
        if len(self._groups) >= _MOST_GROUPS:
            self._groups.clear()
        group = self.layout.container(*name)
        if not (target.container_id and group.is_dir()):
            return None
        self._groups[name] = group
        return group


class Agent:
    """Carries out what policies want of this node."""

    def __init__(self, settings: AgentSettings, scheduler: SchedulerBase, watch: WriteWatch) -> None:
        self._settings, self._scheduler, self._watch = settings, scheduler, watch
        self._refusals = Refusals()
        self._cpus = os.cpu_count() or 1
        self._admission = Admission(self._cpus)
        self._namespaces = PodNamespaces(settings.logs)
        self._ledger = Ledger(settings.state / "agent.journal")
        self._graces: dict[str, DisposableBase] = {}
        self._sources: set[str] = set()
        self._writers: _CgroupWriters | None = None
        self._missing: dict[str, list[str]] = {}
        self._unlimited = ""
        self._followed: dict[str, dict[Path, OrderTarget]] = {}

    def start(self) -> None:
        """Probe the node, and start the grace period of every policy whose changes an earlier run left behind."""
        self._settings.state.mkdir(parents=True, exist_ok=True)
        self._ledger.load()
        self._equip()
        for policy in {entry.policy for entry in self._ledger.entries.values()}:
            log.info("%s: a former agent was killed; waiting for the policy's plan", policy)
            self._await_source(policy)

    def stop(self) -> None:
        """Undo everything, for every policy."""
        for grace in self._graces.values():
            grace.dispose()
        for policy in {entry.policy for entry in self._ledger.entries.values()}:
            self._release(policy)

    def hear(self, policy: str, payload: bytes | None, signed: int) -> Stamp | None:
        """Carry out a plan for the policy, or its withdrawal (None). Bad messages are counted, never raised.

        `signed` is the time of signing in nanoseconds since 1970. Returns the stamp of a plan that was carried out.
        """
        try:
            if payload is None:
                self._admission.withdraw(policy, signed)
                self._release(policy)
                return None
            heard = orders.read(payload, policy, self._settings.node)
            order = self._admission.admit(heard, signed)
        except OrderError as error:
            self.refuse(error)
            return None
        if order is None or order.mode is Mode.ENFORCE:
            self._hold(policy)
        if order is not None:
            if not self._persist(lambda: self._obey(order)):
                return None
            OBEYED_SECONDS.observe(max(0.0, (time.time_ns() - signed) / 1e9))
        return heard.stamp

    def refuse(self, error: OrderError) -> None:
        """Count and log a message that must not be obeyed."""
        self._refusals.note(error.reason, str(error))

    def find_source(self, policy: str) -> None:
        """A source of plans for the policy is alive."""
        self._sources.add(policy)

    def lose_source(self, policy: str) -> None:
        """The policy's source of plans is gone, or cut off by the network: its grace period begins."""
        self._sources.discard(policy)
        self._admission.lose_source(policy)
        self._await_source(policy)

    def on_other_write(self, path: Path) -> None:
        """Somebody else wrote a CPU limit that we watch."""
        writers = self._writers
        if writers is not None:
            self._persist(lambda: writers.limits.on_other_write(path))

    def report(self) -> dict[str, Any]:
        """What this node can do, what it lacks for the rest, and how often it refused what, as a JSON object."""
        layout = self._writers.layout if self._writers else None
        return {
            "node": self._settings.node,
            "cgroup": layout.version if layout else None,
            "driver": layout.driver if layout else None,
            "processors": self._cpus,
            "quotaPeriod": capabilities.quota_period(layout),
            "missing": self._missing,
            "unlimited": self._unlimited,
            "refused": dict(self._refusals.counts),
        }

    def usage(self) -> dict[str, Any]:
        """What the containers of all plans have used so far, as a JSON object (see `agent.usage`)."""
        if self._writers is None:
            return {"at": time.monotonic(), "containers": {}}
        followed = [(t.container_id, group) for groups in self._followed.values() for group, t in groups.items()]
        return usage(self._writers.layout, followed, time.monotonic())

    def _equip(self) -> _CgroupWriters | None:
        """Find the pods' cgroups unless that is done; retried with each order, as the kubelet may start after us."""
        if self._writers is None:
            layout = find_cgroups(self._settings.cgroup_root)
            facts = capabilities.probe(layout)
            self._missing, self._unlimited = capabilities.missing(facts), capabilities.unlimited(facts)
            if layout is not None:
                self._writers = _CgroupWriters(
                    layout, self._ledger, self._refusals, self._watch, self._settings.priority
                )
        return self._writers

    def _obey(self, order: NodeOrder) -> None:
        writers = self._equip()
        lacks = self._missing.get(order.scheduler) if order.targets else None
        if writers is None or lacks:
            self._refusals.note("Incapable", f"{order.policy}: {order.scheduler}: {'; '.join(lacks or ())}")
            return
        groups = self._followed[order.policy] = self._groups(writers, order)
        if order.scheduler is Scheduler.REALTIME:
            # Limits first: they must be in force when suspended threads fall back to the fair scheduler.
            resting = {group for group, target in groups.items() if target.suspended}
            writers.limits.apply(order.policy, dict.fromkeys(resting, QUANTUM), held=True)
            parts = {group: target.part(self._cpus) for group, target in groups.items()}
            writers.realtime.apply(order.policy, parts, order.manner, resting)
            return
        # Settled first: `apply` makes an earlier run's entries its own, as if no resize had confirmed them yet.
        for group, target in groups.items():
            if target.limit is not None:
                writers.limits.settle(group, target.limit)
        writers.limits.apply(order.policy, _shares(groups))
        writers.realtime.release(order.policy)

    def _groups(self, writers: _CgroupWriters, order: NodeOrder) -> dict[Path, OrderTarget]:
        """The cgroups of the targets on this node: a path of the pod's UID and the container's ID must exist.

        Containers outside the policy's own namespace are refused, whoever signed the plan.
        """
        groups = {}
        for target in order.targets:
            group = writers.group(target)
            if group is None:
                self._refusals.note("NotHere", f"{order.policy}: {target.container_id or 'a container that starts'}")
            elif (namespace := self._namespaces.of(target.uid)) != order.namespace:
                self._refusals.note("Foreign", f"{order.policy}: {target.container_id} is of namespace {namespace}")
            else:
                groups[group] = target
        return groups

    def _release(self, policy: str) -> None:
        """Undo everything for the policy."""
        self._end_grace(policy)
        self._followed.pop(policy, None)
        self._admission.drop(policy)
        writers = self._writers
        if writers is not None:
            self._persist(lambda: writers.limits.release(policy))
            self._persist(lambda: writers.realtime.release(policy))

    def _await_source(self, policy: str) -> None:
        self._end_grace(policy)
        self._graces[policy] = self._scheduler.schedule_relative(self._settings.grace, lambda *_: self._give_up(policy))

    def _give_up(self, policy: str) -> None:
        if self._ledger.of(policy):
            log.warning("%s: no plans for %g s; undoing what the API did not confirm", policy, self._settings.grace)
        self._release(policy)
        self._admission.forget(policy)

    def _hold(self, policy: str) -> None:
        """A plan holds while its source lives. One that was delayed may have none any more: start the grace period."""
        if policy in self._sources:
            self._end_grace(policy)
        elif policy not in self._graces:
            self._await_source(policy)

    def _persist(self, action: Callable[[], None]) -> bool:
        """Retry when a container ends meanwhile; the next attempt leaves it out. False when no attempt succeeded."""
        for _ in range(_ATTEMPTS):
            try:
                action()
            except ActuationError as error:
                self._refusals.note(error.reason, str(error))
            else:
                return True
        return False

    def _end_grace(self, policy: str) -> None:
        grace = self._graces.pop(policy, None)
        if grace is not None:
            grace.dispose()


def _shares(groups: dict[Path, OrderTarget]) -> dict[Path, int]:
    return {group: target.share for group, target in groups.items()}
