"""Make plans real by resizing pods in place (KEP-1287): decreases first, the latest plan wins, originals are kept.

Level-triggered: `apply` says what should be, `observe` what is, and every difference becomes a patch. All methods run
on the loop's thread; patches run on workers and report back to it.
"""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING, Protocol

from contextpolicy.actuators.order import Order
from contextpolicy.actuators.resize.guard import Guard
from contextpolicy.actuators.resize.headroom import allowed
from contextpolicy.actuators.resize.patches import cpu_for
from contextpolicy.actuators.resize.pod_job import Job, carry_out
from contextpolicy.actuators.resize.pod_slot import SETTLING, PodSlot
from contextpolicy.actuators.resize.restoring import falling, to_restore, without_rises
from contextpolicy.cluster.claims import container_id
from contextpolicy.cluster.pods import Cpu
from contextpolicy.policy.spec import Control

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from concurrent.futures import Executor

    from reactivex.abc import SchedulerBase

    from contextpolicy.actuators.resize.contest import Contest
    from contextpolicy.actuators.resize.headroom import Holding
    from contextpolicy.actuators.resize.pod_job import Outcome, ResizeApi
    from contextpolicy.cluster.pods import ContainerView, PodView
    from contextpolicy.errors import ActuationError

    _Wish = tuple[PodSlot, ContainerView, Cpu]

RESTORE_PATIENCE = 2.0
"""Seconds for which what is put back waits with rising until what falls has fallen: a refusal, or a kubelet that is
gone, must not keep it."""
ROUNDING = 1e-3
"""Seconds that a timer comes later than what it is for: moments are compared as floats."""


class Observer(Protocol):
    """Who wants to know how resizing goes; called on the loop's thread."""

    def on_accepted(self, policy: str, container: str, cpu: Cpu, answered: float) -> None:
        """The API has the new resources, since this monotonic time."""

    def on_in_force(self, policy: str, container: str, limit: int) -> None:
        """The kubelet reports the limit that the plan wants."""

    def on_problem(self, policy: str, pod: str, error: ActuationError | None) -> None:
        """A patch failed, or after a failure works again (None)."""

    def on_contest(self, policy: str, container: str, contest: Contest | None) -> None:
        """Somebody else resized a container of the policy, or has not done so for a while (None)."""


class PodResizer:
    """All pods that policies claim, and those that must be put back."""

    def __init__(self, api: ResizeApi, scheduler: SchedulerBase, workers: Executor, observer: Observer) -> None:
        self._api, self._scheduler, self._workers, self._observer = api, scheduler, workers, observer
        self._slots: dict[str, PodSlot] = {}
        self._orders: dict[str, Order] = {}
        self._released: dict[str, Callable[[], None]] = {}
        self._falling: dict[str, dict[str, float]] = {}
        self._guard = Guard(scheduler, observer.on_contest, self._wake)

    def apply(self, order: Order) -> None:
        """Let this be what the policy wants; replaces what it wanted before."""
        self._orders[order.policy] = order
        self._released.pop(order.policy, None)
        self._drive(order.policy)

    def release(self, policy: str, done: Callable[[], None]) -> None:
        """Put all containers of the policy back as they were, then call `done`; asking again tries refusals again."""
        self._orders[policy] = Order(policy, frozenset())
        self._released[policy] = done
        for slot in self._slots.values():
            slot.ask_again(policy, restore=True)
        self._drive(policy)

    def observe(self, view: PodView) -> None:
        """Take a pod as the watch shows it."""
        slot = self._slots.get(view.uid)
        if slot is None:
            slot = self._slots[view.uid] = PodSlot(view)
        before = {c.name: c.actual for c in slot.view.containers}
        slot.observe(view, now := self._now())
        if slot.oversight.since == now:
            self._wake(slot.oversight.until - now)
        self._tell_in_force(slot, before)
        self._drive_all()

    def forget(self, uid: str) -> None:
        """The pod is gone."""
        if self._slots.pop(uid, None):
            self._drive_all()

    def _drive_all(self) -> None:
        """Policies share pods: what ends for one may be what another waited for."""
        for policy in list(self._orders):
            self._drive(policy)

    def _drive(self, policy: str) -> None:
        """Send every patch of the policy that may be sent now."""
        order = self._orders[policy]
        claimed = list(self._claimed(order))
        for slot, container, cpu in claimed:
            self._guard.look(policy, slot, container, cpu)
        steps = self._steps(order, claimed)
        back = {uid: to_restore(slot, policy, order.claimed) for uid, slot in self._slots.items()}
        bound = self._bound(order, restoring=any(back.values()))
        for uid, slot in list(self._slots.items()):
            slot.let_go(policy, order.claimed)
            if slot.view.ended:
                continue
            ready = without_rises(slot, back[uid]) if slot.view.node in bound else back[uid]
            self._attend(policy, slot, steps[uid], restore=False)
            self._attend(policy, slot, ready, restore=True)
            if not (steps[uid] or back[uid] or slot.job):
                self._recovered(policy, slot)
        self._let_go(policy)

    def _let_go(self, policy: str) -> None:
        """Tell that a released policy has nothing left to put back."""
        if policy in self._released and not any(slot.holds(policy) for slot in self._slots.values()):
            del self._orders[policy]
            self._falling.pop(policy, None)
            self._released.pop(policy)()

    def _bound(self, order: Order, *, restoring: bool) -> set[str]:
        """The nodes on which nothing that is put back may rise yet."""
        now, before = self._now(), self._falling.get(order.policy, {})
        slots = self._slots.values() if restoring else ()
        nodes = {slot.view.node for slot in slots if falling(slot, order.policy, order.claimed)}
        self._falling[order.policy] = since = {node: before.get(node, now) for node in nodes}
        if nodes - before.keys():
            self._wake(RESTORE_PATIENCE)
        return {node for node, moment in since.items() if now < moment + RESTORE_PATIENCE}

    def _attend(self, policy: str, slot: PodSlot, wanted: dict[str, Cpu], *, restore: bool) -> None:
        """Send what one pod needs: steps to the plan, or containers to put back that the policy claims no more."""
        now = self._now()
        if not wanted:
            slot.ask_again(policy, restore=restore)
        elif not slot.refuses(policy, wanted, now, restore=restore) and slot.job is None and not slot.settling(now):
            self._send(policy, slot, wanted, restore=restore)

    def _steps(self, order: Order, wishes: Iterable[_Wish]) -> Mapping[str, dict[str, Cpu]]:
        """What differs from the plan and may be set now, by pod."""
        now = self._now()
        steps: dict[str, dict[str, Cpu]] = defaultdict(dict)
        by_node: dict[str, list[tuple[PodSlot, ContainerView, Holding, Cpu]]] = defaultdict(list)
        seen = set()
        for slot, container, cpu in wishes:
            by_node[slot.view.node].append((slot, container, slot.holding(container.name, cpu), cpu))
            seen.add(container_id(slot.view, container.name))
        for node, claimed in by_node.items():
            # A container that we have not seen yet may hold anything: until then nothing rises.
            known = order.claimed & order.shares.keys() <= seen
            capacity = order.capacity.get(node, 0) - self._leaving(order, node) if known else 0
            may = allowed(capacity, [holding for *_, holding, _ in claimed])
            for slot, container, holding, cpu in claimed:
                free = holding.id in may or order.control is Control.WEIGHT
                step = slot.step(container, cpu, now)
                if free and step != slot.spec(container.name) and not slot.rests(container.name, now):
                    steps[slot.view.uid][container.name] = step
        return steps

    def _leaving(self, order: Order, node: str) -> int:
        """What the policy gave to pods that are being deleted: it is theirs until their containers have ended."""
        return sum(
            slot.highest(name)
            for slot in self._slots.values()
            if slot.view.ended and slot.view.running and slot.view.node == node
            for name, original in slot.originals.items()
            if original.policy == order.policy
        )

    def _claimed(self, order: Order) -> Iterator[_Wish]:
        """What has a share; a plan that is ordered late may have shares for what the policy has lost since."""
        for slot in self._slots.values():
            for container in slot.view.containers:
                identity = container_id(slot.view, container.name)
                if identity in order.claimed and identity in order.shares and not slot.view.ended:
                    yield slot, container, self._cpu(order, slot, container, order.shares[identity])

    def _cpu(self, order: Order, slot: PodSlot, container: ContainerView, share: int) -> Cpu:
        ceiling = order.ceilings.get(container_id(slot.view, container.name), share)
        cpu = cpu_for(slot.view, container, share, order.control, ceiling)
        before = slot.before(container.name)
        if before is None or order.control is not Control.LIMIT or slot.view.qos == "Guaranteed":
            return cpu
        return Cpu(before.request, cpu.limit)

    def _send(self, policy: str, slot: PodSlot, wanted: dict[str, Cpu], *, restore: bool) -> None:
        changed = {name: cpu for name, cpu in wanted.items() if slot.spec(name) != cpu}
        if restore:
            note = {name: original for name, original in slot.originals.items() if name not in wanted}
        else:
            note = slot.note(policy, set(wanted))
        fresh = slot.unsure or note != slot.view.originals
        job = Job(policy, slot.view, wanted, changed, note, note=fresh, restore=restore)
        slot.begin(job)
        self._workers.submit(self._work, slot, job)

    def _work(self, slot: PodSlot, job: Job) -> None:
        """On a worker's thread: the outcome goes back to the loop."""
        outcome = carry_out(self._api, job)
        self._scheduler.schedule(lambda *_: self._finish(slot, job, outcome))

    def _finish(self, slot: PodSlot, job: Job, outcome: Outcome) -> None:
        if self._slots.get(slot.view.uid) is not slot:
            return
        pause = slot.finish(job, outcome, self._now())
        if outcome.resized:
            self._wake(SETTLING)
        if outcome.error is None:
            self._recovered(job.policy, slot)
            for name, cpu in job.wanted.items():
                self._observer.on_accepted(job.policy, container_id(slot.view, name), cpu, outcome.answered)
        elif outcome.error.reason == "NotFound":
            del self._slots[slot.view.uid]
        else:
            self._fail(job.policy, slot, outcome.error, pause)
        self._drive_all()

    def _fail(self, policy: str, slot: PodSlot, error: ActuationError, pause: float) -> None:
        slot.troubled.add(policy)
        self._observer.on_problem(policy, slot.view.name, error)
        if error.retriable:
            self._scheduler.schedule_relative(pause, lambda *_: self._retry(slot))
        else:
            self._wake(pause)

    def _recovered(self, policy: str, slot: PodSlot) -> None:
        if policy in slot.troubled:
            slot.troubled.discard(policy)
            self._observer.on_problem(policy, slot.view.name, None)

    def _retry(self, slot: PodSlot) -> None:
        slot.job = None
        self._drive_all()

    def _wake(self, seconds: float) -> None:
        """Look again then: a pause is over."""
        self._scheduler.schedule_relative(seconds + ROUNDING, lambda *_: self._drive_all())

    def _now(self) -> float:
        return self._scheduler.to_seconds(self._scheduler.now)

    def _tell_in_force(self, slot: PodSlot, before: Mapping[str, Cpu | None]) -> None:
        for order in self._orders.values():
            for container in slot.view.containers:
                identity = container_id(slot.view, container.name)
                share, actual = order.shares.get(identity), container.actual
                if actual is None or share is None or actual == before.get(container.name):
                    continue
                wanted = self._cpu(order, slot, container, share)
                if actual.limit == wanted.limit and (order.control is Control.LIMIT or actual == wanted):
                    self._observer.on_in_force(order.policy, identity, share)
