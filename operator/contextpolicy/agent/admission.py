"""Which orders the agent obeys. Pure.

The operator has signed what comes here (`bus.signatures`); but whoever can listen can say it again, and an operator may
be wrong: what is out of turn or out of proportion is refused.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from contextpolicy.bus.signatures import MAX_AGE
from contextpolicy.errors import OrderError
from contextpolicy.planning.seating import REALTIME_BUDGET
from contextpolicy.policy.spec import Control, Mode, Scheduler

if TYPE_CHECKING:
    from contextpolicy.agent.node_orders import NodeOrder, OrderTarget
    from contextpolicy.cluster.agent_reports import Stamp


REPEATABLE = int(2 * MAX_AGE * 1e9)
"""Nanoseconds. Messages that pass for fresh are signed within that of each other, unless a clock was set."""


class Admission:
    """Remembers what it admitted: each policy's place in time, and who has which container.

    A stamp (run, sequence, edition) puts the plans of one source in order, the time of signing everything else.
    """

    def __init__(self, cpus: int) -> None:
        self._cpus = cpus
        self._stamps: dict[str, Stamp] = {}
        self._signed: dict[str, int] = {}
        self._sourceless: set[str] = set()
        self._admitted: dict[str, NodeOrder] = {}
        self._wishes: dict[str, NodeOrder] = {}

    def admit(self, order: NodeOrder, signed: int) -> NodeOrder | None:
        """The part of the order to obey: no targets when the policy wants nothing of the agent; None for a repetition.

        A message that only tells how weights went on is one: what an owner wrote since then stays until the next plan.
        OrderError when it comes out of turn, or asks for more than the node has or for what another policy has.
        """
        if not self._is_news(order, signed):
            return None
        wishes = _wishes(order)
        if self._wishes.get(order.policy) == wishes:
            self._stamps[order.policy], self._signed[order.policy] = order.stamp, signed
            return None
        if order.mode is not Mode.ENFORCE or (order.scheduler, order.control) == (Scheduler.CFS, Control.WEIGHT):
            order = replace(order, targets=())
        self._check_amounts(order)
        self._check_owners(order)
        self._sourceless.discard(order.policy)
        self._stamps[order.policy] = order.stamp
        self._signed[order.policy] = signed
        self._admitted[order.policy], self._wishes[order.policy] = order, wishes
        return order

    def withdraw(self, policy: str, signed: int) -> None:
        """The policy's plans are withdrawn; OrderError when that was before its last plan."""
        self._check_time(policy, signed)
        self._signed[policy] = signed
        self.drop(policy)

    def lose_source(self, policy: str) -> None:
        """The source of the policy's plans went away; another one may count its runs by another clock."""
        self._sourceless.add(policy)

    def drop(self, policy: str) -> None:
        """The policy has nothing here any more. What it ordered before is still out of turn, if it comes now."""
        self._admitted.pop(policy, None)
        self._wishes.pop(policy, None)

    def forget(self, policy: str) -> None:
        """Nobody was heard for long: whatever comes next is news."""
        self.drop(policy)
        self._stamps.pop(policy, None)

    def _is_news(self, order: NodeOrder, signed: int) -> bool:
        last = self._stamps.get(order.policy)
        another_source = order.policy in self._sourceless and last is not None and order.stamp[0] != last[0]
        if last is not None and order.stamp < last and not another_source:
            raise OrderError("Outdated", f"{order.policy}: {order.stamp} came after {last}")
        if last is None or another_source:
            self._check_time(order.policy, signed)
        return order.stamp != last

    def _check_time(self, policy: str, signed: int) -> None:
        later = self._signed.get(policy, 0) - signed
        if 0 <= later <= REPEATABLE:
            raise OrderError("Outdated", f"{policy}: signed {later / 1e9:.3f} s before what was heard already")

    def _check_amounts(self, order: NodeOrder) -> None:
        realtime = order.scheduler is Scheduler.REALTIME
        there_is = REALTIME_BUDGET - self._promised(order.policy) if realtime else self._cpus * 1000
        asked = sum(target.share for target in order.targets)
        if order.targets and order.capacity > (REALTIME_BUDGET if realtime else there_is):
            raise OrderError("TooMuch", f"{order.policy}: a capacity of {order.capacity}m, this node has {there_is}m")
        if asked > min(order.capacity, there_is):
            raise OrderError("TooMuch", f"{order.policy}: {asked}m of {min(order.capacity, there_is)}m")

    def _promised(self, but: str) -> int:
        """What the other policies have of the realtime budget: unlike CPU limits it can't be overcommitted."""
        others = [order for policy, order in self._admitted.items() if policy != but]
        return sum(t.share for order in others if order.scheduler is Scheduler.REALTIME for t in order.targets)

    def _check_owners(self, order: NodeOrder) -> None:
        owners = {t.container_id: p for p, held in self._admitted.items() if p != order.policy for t in _named(held)}
        wanted = [target.container_id for target in _named(order)]
        if len(set(wanted)) < len(wanted):
            raise OrderError("Twice", f"{order.policy}: names a container twice")
        taken = next((identity for identity in wanted if identity in owners), None)
        if taken is not None:
            raise OrderError("Owned", f"{order.policy}: {taken} belongs to {owners[taken]}")


def _wishes(order: NodeOrder) -> NodeOrder:
    """The order without its edition and without what it found in force."""
    return replace(
        order, stamp=(*order.stamp[:2], 0), targets=tuple(replace(target, limit=None) for target in order.targets)
    )


def _named(order: NodeOrder) -> list[OrderTarget]:
    """The targets that run already."""
    return [target for target in order.targets if target.container_id]
