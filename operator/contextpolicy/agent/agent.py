"""One node's agent: turns orders into cgroup writes; everything here runs on the loop's thread."""

from __future__ import annotations

import logging
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from reactivex import Subject

from contextpolicy.agent import node_orders as orders
from contextpolicy.agent.admission import Admission
from contextpolicy.agent.agent_metrics import OBEYED_SECONDS
from contextpolicy.agent.drains import Drains
from contextpolicy.agent.failures import GONE, by_container, outside
from contextpolicy.agent.ledger import Ledger
from contextpolicy.agent.node_equipment import NodeEquipment
from contextpolicy.agent.plan_sources import PlanSources
from contextpolicy.agent.pod_namespaces import PodNamespaces
from contextpolicy.agent.refusals import Refusals
from contextpolicy.agent.retries import Retries
from contextpolicy.agent.target_groups import TargetGroups
from contextpolicy.agent.usage import usage
from contextpolicy.cluster.agent_reports import Confirmation
from contextpolicy.errors import OrderError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from pathlib import Path

    from reactivex.abc import SchedulerBase

    from contextpolicy.agent.agent_settings import AgentSettings
    from contextpolicy.agent.cgroup_writers import CgroupWriters
    from contextpolicy.agent.failures import Failures
    from contextpolicy.agent.inotify import WriteListener
    from contextpolicy.agent.node_orders import NodeOrder, OrderTarget
    from contextpolicy.agent.open_files import FileWatch

log = logging.getLogger(__name__)


class Agent:
    """Carries out what policies want of this node."""

    def __init__(
        self, settings: AgentSettings, scheduler: SchedulerBase, watch_for: Callable[[WriteListener], FileWatch]
    ) -> None:
        """`watch_for` makes the watch that reports to us."""
        self._settings, self._scheduler = settings, scheduler
        self._refusals = Refusals()
        self._ledger = Ledger(settings.state / "agent.journal")
        self._node = NodeEquipment(settings, self._ledger, watch_for(self))
        self._admission = Admission(self._node.processors)
        self._targets = TargetGroups(PodNamespaces(settings.logs), self._refusals)
        self._sources = PlanSources(scheduler, settings.grace, self)
        self._retries = Retries(scheduler, self)
        self._drains = Drains(scheduler, self)
        self._orders: dict[str, NodeOrder] = {}
        self.late: Subject[Confirmation] = Subject()
        """What became of a plan after it was confirmed."""
        self._followed: dict[str, dict[Path, OrderTarget]] = {}

    def start(self) -> None:
        """Probe the node, and start the grace period of every policy whose changes an earlier run left behind."""
        self._ledger.load()
        self._node.find()
        for policy in {entry.policy for entry in self._ledger.entries.values()}:
            log.info("%s: an earlier agent was killed; waiting for the policy's plan", policy)
            self._sources.wait(policy)

    @property
    def journal_is_damaged(self) -> bool:
        """Whether what an earlier run left behind is not known completely."""
        return self._ledger.is_damaged

    def stop(self) -> None:
        """Undo everything, for every policy, except what the API agrees with while plans are still published."""
        self._sources.stop()
        for policy in {entry.policy for entry in self._ledger.entries.values()}:
            self._release(policy, leave_agreed=policy in self._sources)
        self._retries.stop()

    def hear(self, policy: str, payload: bytes | None, signed: int) -> Confirmation | None:
        """Carry out a plan for the policy, or its withdrawal (None). Bad messages are counted, never raised.

        `signed` is the time of signing in nanoseconds since 1970. Returns what became of a plan that was obeyed.
        """
        heard = None
        try:
            if payload is None:
                self._admission.withdraw(policy, signed)
                self._release(policy)
                return None
            heard = orders.read(payload, policy, self._settings.node)
            order = self._admission.admit(heard, signed)
        except OrderError as error:
            self.refuse(error)
            self._give_way(policy, heard, signed)
            return None
        if order is None or order.mode.acts:
            self._sources.hold(policy)
        failed = self._obey(order) if order is not None else {}
        if failed:
            self._admission.fail(policy)
        elif order is not None:
            OBEYED_SECONDS.observe(max(0.0, (time.time_ns() - signed) / 1e9))
        return Confirmation(policy, heard.stamp, failed)

    def refuse(self, error: OrderError) -> None:
        """Count and log a message that must not be obeyed."""
        self._refusals.note(error.reason, str(error))

    def miss(self, policy: str, payload: bytes | None, signed: int) -> None:
        """The operator has signed this, but too long ago by our clock: it is not obeyed, and may end the plan before.

        Such a message was refused already.
        """
        heard = None
        with suppress(OrderError):
            heard = orders.read(payload, policy, self._settings.node) if payload is not None else None
        self._give_way(policy, heard, signed)

    def find_source(self, policy: str) -> None:
        """A source of plans for the policy is alive: a plan that we carry out holds, whenever it says it once more.

        What a killed agent left waits for the plan itself.
        """
        self._sources.find(policy)
        if policy in self._orders:
            self._sources.hold(policy)

    def lose_source(self, policy: str) -> None:
        """The policy's source of plans is gone, or cut off by the network: its grace period begins."""
        self._sources.lose(policy)
        self._admission.lose_source(policy)

    def doubt(self, policy: str) -> bool:
        """A message for the policy came without proof of its sender; returns whether its source has to publish again.

        If it can't, the operator signs with a key that we do not know, and what we wrote would only be defended against
        its resizes.
        """
        doubtful = policy in self._orders and policy in self._sources
        if doubtful:
            self._sources.doubt(policy)
        return doubtful

    def on_silence(self, policy: str) -> None:
        """The grace period ended without proof that the policy's plan still holds: release it."""
        if self._ledger.of(policy):
            log.warning("%s: no valid plan during the grace period; undoing the last one", policy)
        self._release(policy, leave_agreed=policy in self._sources)
        self._admission.forget(policy)

    def on_write(self, path: Path, heard: float) -> None:
        """See `on_other_write`; called on the watch's thread."""
        self._scheduler.schedule(lambda *_: self.on_other_write(path, heard))

    def on_other_write(self, path: Path, heard: float) -> None:
        """Another process wrote a file that we watch, as we `heard` then, in seconds on the monotonic clock."""
        if self._node.writers is not None:
            failures = self._node.writers.on_other_write(path, heard)
            self._note(failures)
            self._report_late(failures, self._followed)

    def on_retry(self, key: str) -> None:
        """Something of this policy failed: carry out its newest order again, or undo again what it left."""
        order = self._orders.get(key)
        if order is not None:
            self._confirm_late(key, self._obey(order))
        elif self._node.writers is not None:
            self._follow_up(key, self._node.writers.release(key))

    def on_drained(self, policy: str) -> None:
        """A suspended task has had its time: carry out the newest order as far as it goes by now."""
        failed = self._obey(self._orders[policy])
        if failed or self._admission.is_failing(policy):
            self._confirm_late(policy, failed)

    def report(self) -> dict[str, Any]:
        """The node's capabilities, what the missing ones lack, and counts of refusals, as a JSON object."""
        return {**self._node.report(), "refused": dict(self._refusals.counts)}

    def usage(self) -> dict[str, Any]:
        """What the containers of all plans have used so far, as a JSON object (see `agent.usage`)."""
        if self._node.writers is None:
            return {"at": time.monotonic(), "containers": {}}
        followed = [(t.container_id, group) for groups in self._followed.values() for group, t in groups.items()]
        return usage(self._node.writers.layout, followed, time.monotonic())

    def _obey(self, order: NodeOrder) -> dict[str, str]:
        """Carry out the order; returns the containers that did not get what they should have, and why.

        Among them are those that it no longer names and that could not be undone.
        """
        writers = self._node.find()
        lacks = self._node.missing.get(order.scheduler) if order.targets else None
        if writers is None or lacks:
            self._undo(order.policy, leave_agreed=order.policy in self._sources)
            self._refusals.note("Incapable", f"{order.policy}: {order.scheduler}: {'; '.join(lacks or ())}")
            return {target.container_id: "Incapable" for target in order.targets if target.container_id}
        groups, refused = self._targets.find(writers, order)
        before = self._orders.get(order.policy)
        self._followed[order.policy] = groups
        self._orders[order.policy] = order
        again = before is not None and before.stamp[:2] == order.stamp[:2]  # another edition is no new plan
        failures = self._carry_out(writers, order, groups, again=again)
        left = {
            writers.name(group): error.reason for group, error in outside(failures, self._followed.values()).items()
        }
        return refused | left | by_container(failures, _names(groups))

    def _carry_out(
        self, writers: CgroupWriters, order: NodeOrder, groups: Mapping[Path, OrderTarget], *, again: bool
    ) -> Failures:
        resting = [group for group, target in groups.items() if order.drains and target.suspended]
        failures = writers.apply(order, groups, self._drains.rest(order.policy, resting), again=again)
        self._follow_up(order.policy, failures)
        return failures

    def _report_late(self, failures: Failures, policies: Iterable[str]) -> None:
        """Say which containers do not have what the plan says any more, and try again; not which have ended."""
        left = {group: error for group, error in failures.items() if error.reason != GONE}
        for policy in policies:
            failed = by_container(left, _names(self._followed[policy]))
            if failed:
                self._retries.again(policy)
                self._confirm_late(policy, failed)

    def _confirm_late(self, policy: str, failed: Mapping[str, str]) -> None:
        stamp = self._admission.stamp(policy)
        if stamp is not None:
            (self._admission.fail if failed else self._admission.recover)(policy)
            self.late.on_next(Confirmation(policy, stamp, failed))

    def _follow_up(self, policy: str, failures: Failures) -> None:
        """What an order of the policy, or its release, came to: count what failed, and try again later.

        What is gone needs neither. Weights are written for all policies together.
        """
        self._note(failures)
        self._report_late(failures, self._followed.keys() - {policy})
        if any(error.reason != GONE for error in failures.values()) or not self._ledger.is_saved:
            self._retries.again(policy)
        else:
            self._retries.end(policy)

    def _give_way(self, policy: str, refused: NodeOrder | None, signed: int) -> None:
        """The operator wants something newer, which was refused: leave the policy to its resizes, as at our end.

        What we wrote for the plan before would only be defended against them.
        """
        if self._admission.is_overtaken(policy, refused.stamp if refused else None, signed):
            log.warning("%s: a newer plan was refused; undoing the previous one", policy)
            self._release(policy, leave_agreed=policy in self._sources)

    def _release(self, policy: str, *, leave_agreed: bool = False) -> None:
        """The policy has no plan any more: undo everything for it, but for what the API has if `leave_agreed`."""
        self._sources.end(policy)
        self._admission.drop(policy)
        self._undo(policy, leave_agreed=leave_agreed)

    def _undo(self, policy: str, *, leave_agreed: bool) -> None:
        self._orders.pop(policy, None)
        self._followed.pop(policy, None)
        self._drains.forget(policy)
        if self._node.writers is not None:
            self._follow_up(policy, self._node.writers.release(policy, leave_agreed=leave_agreed))

    def _note(self, failures: Failures) -> None:
        for error in failures.values():
            if error.reason != GONE:
                self._refusals.note(error.reason, str(error))


def _names(groups: Mapping[Path, OrderTarget]) -> dict[Path, str]:
    return {group: target.container_id for group, target in groups.items()}
