"""Which orders the agent obeys. Pure.

Signatures are checked before (`bus.signatures`), but anyone who can listen can replay a signed message, and an
operator may be wrong: orders that are outdated or ask for too much are refused.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING

from contextpolicy.bus.signatures import MAX_AGE
from contextpolicy.errors import OrderError
from contextpolicy.planning.allocation.seating import REALTIME_BUDGET
from contextpolicy.policy.spec import Scheduler

if TYPE_CHECKING:
    from collections.abc import Callable

    from contextpolicy.agent.node_orders import NodeOrder, OrderTarget
    from contextpolicy.cluster.agent_reports import Stamp

    _Desired = tuple[object, ...]

REPEATABLE = int(2 * MAX_AGE * 1e9)
"""Nanoseconds between the signing times of two messages that both count as fresh, at most, unless a clock was set."""


class Admission:
    """Remembers each policy's last admitted order, and so which policy has which container.

    Plans of one source are ordered by their stamp (run, sequence, edition), everything else by the time of signing.
    """

    def __init__(self, cpus: Callable[[], int]) -> None:
        """`cpus` says how many processors the node has: some may be switched on later."""
        self._cpus = cpus
        self._stamps: dict[str, Stamp] = {}
        self._signed: dict[str, int] = {}
        self._sourceless: set[str] = set()
        self._failed: set[str] = set()
        self._admitted: dict[str, NodeOrder] = {}
        self._desired: dict[str, _Desired] = {}

    def admit(self, order: NodeOrder, signed: int) -> NodeOrder | None:
        """The order to obey, without targets if the policy wants nothing of the agent; None for a repetition.

        A message with new weights but the same shares is a repetition: what an owner wrote meanwhile stays until the
        next plan. An order that failed is obeyed again with each repetition. OrderError when the order is outdated, or
        asks for more than the node has or for another policy's container.
        """
        failed = self.is_failing(order.policy)
        if not self._is_news(order, signed) and not failed:
            return None
        desired = _desired(order)
        if self._desired.get(order.policy) == desired and not failed:
            self._stamps[order.policy], self._signed[order.policy] = order.stamp, signed
            return None
        if not order.mode.acts:
            order = replace(order, targets=())
        self._check_parts(order)
        self._check_amounts(order)
        self._check_owners(order)
        self._sourceless.discard(order.policy)
        self._failed.discard(order.policy)
        self._stamps[order.policy] = order.stamp
        self._signed[order.policy] = signed
        self._admitted[order.policy], self._desired[order.policy] = order, desired
        return order

    def is_overtaken(self, policy: str, stamp: Stamp | None, signed: int) -> bool:
        """Whether a message of the operator that was refused is newer than the policy's last admitted order.

        That order is not what the operator wants any more. Without a stamp the message could not be read, or was a
        withdrawal.
        """
        if policy not in self._admitted:
            return False
        if stamp is None or self._is_another_source(policy, stamp):
            return signed > self._signed.get(policy, 0)
        return stamp > self._stamps[policy]

    def stamp(self, policy: str) -> Stamp | None:
        """That of the policy's last admitted order."""
        return self._stamps.get(policy)

    def fail(self, policy: str) -> None:
        """The policy's last admitted order was not carried out, or only in part."""
        self._failed.add(policy)

    def recover(self, policy: str) -> None:
        """What failed of the policy's last admitted order is carried out by now."""
        self._failed.discard(policy)

    def is_failing(self, policy: str) -> bool:
        """Whether the policy's last admitted order was not carried out, or only in part."""
        return policy in self._failed

    def withdraw(self, policy: str, signed: int) -> None:
        """The policy's plans are withdrawn; OrderError when its last plan was signed later, or at the same time.

        However much later: after a clock was set back, a withdrawal from before would pass for fresh again.
        """
        self._check_time(policy, signed, inf)
        self._signed[policy] = signed
        self.drop(policy)

    def lose_source(self, policy: str) -> None:
        """The source of the policy's plans is gone; another may number its runs by another clock."""
        self._sourceless.add(policy)

    def drop(self, policy: str) -> None:
        """The policy has no containers any more; replays of its earlier orders are still refused."""
        self._admitted.pop(policy, None)
        self._desired.pop(policy, None)
        self._failed.discard(policy)

    def forget(self, policy: str) -> None:
        """The policy has had no source for the grace period: its next plan is admitted whatever its stamp.

        Signing times are kept for as long as a replay would pass for fresh.
        """
        self.drop(policy)
        self._stamps.pop(policy, None)
        self._sourceless.discard(policy)
        oldest = max(self._signed.values(), default=0) - REPEATABLE
        self._signed = {one: at for one, at in self._signed.items() if at >= oldest}

    def _is_news(self, order: NodeOrder, signed: int) -> bool:
        last = self._stamps.get(order.policy)
        another_source = self._is_another_source(order.policy, order.stamp)
        if last is not None and order.stamp < last and not another_source:
            raise OrderError("Outdated", f"{order.policy}: plan {order.stamp} is older than {last}")
        if last is None or another_source:
            self._check_time(order.policy, signed)
        return order.stamp != last

    def _is_another_source(self, policy: str, stamp: Stamp) -> bool:
        last = self._stamps.get(policy)
        return policy in self._sourceless and last is not None and stamp[0] != last[0]

    def _check_time(self, policy: str, signed: int, most: float = REPEATABLE) -> None:
        later = self._signed.get(policy, 0) - signed
        if 0 <= later <= most:
            raise OrderError("Outdated", f"{policy}: signed {later / 1e9:.3f} s before the latest plan accepted")

    def _check_parts(self, order: NodeOrder) -> None:
        """A realtime share is an integer of thousandths of the period, the same on each processor."""
        cpus = self._cpus()
        for target in order.targets if order.scheduler is Scheduler.REALTIME else ():
            if target.share % cpus:
                raise OrderError("Unreadable", f"{order.policy}: share {target.share}m: expected a multiple of {cpus}m")

    def _check_amounts(self, order: NodeOrder) -> None:
        # Sums of weights are bounded by the operator: they have to fit beside what all other pods request, and here
        # nobody knows these.
        realtime = order.scheduler is Scheduler.REALTIME
        most = self._cpus() * (REALTIME_BUDGET if realtime else 1000)
        there_is = most - self._promised(order.policy) if realtime else most
        asked = sum(target.share for target in order.targets)
        if order.targets and order.capacity > most:
            raise OrderError("TooMuch", f"{order.policy}: capacity {order.capacity}m: expected at most {most}m")
        if asked > min(order.capacity, there_is):
            raise OrderError(
                "TooMuch", f"{order.policy}: shares of {asked}m: expected at most {min(order.capacity, there_is)}m"
            )

    def _promised(self, but: str) -> int:
        """What other policies have of the realtime budget, which unlike CPU limits can't be overcommitted."""
        others = [order for policy, order in self._admitted.items() if policy != but]
        return sum(t.share for order in others if order.scheduler is Scheduler.REALTIME for t in order.targets)

    def _check_owners(self, order: NodeOrder) -> None:
        owners = {t.container_id: p for p, held in self._admitted.items() if p != order.policy for t in _named(held)}
        wanted = [target.container_id for target in _named(order)]
        if len(set(wanted)) < len(wanted):
            raise OrderError("Twice", f"{order.policy}: lists a container twice")
        taken = next((identity for identity in wanted if identity in owners), None)
        if taken is not None:
            raise OrderError("Owned", f"{order.policy}: container {taken} belongs to {owners[taken]}")


def _desired(order: NodeOrder) -> _Desired:
    """The order without its edition and what the kubelet has: what has to change to make it a new one."""
    targets = tuple(target._replace(limit=None, request=None) for target in order.targets)
    return order.stamp[:2], order.mode, order.scheduler, order.capacity, order.manner, targets


def _named(order: NodeOrder) -> list[OrderTarget]:
    """The targets whose container has started, and so has an ID."""
    return [target for target in order.targets if target.container_id]
