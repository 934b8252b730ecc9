"""Make plans real by resizing pods in place (KEP-1287): decreases first, the latest plan wins, originals are kept.

Level-triggered: `apply` says what should be, `observe` what is, and every difference becomes a patch. All methods run
on the loop's thread; patches run on workers and report back to it.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from contextpolicy.actuators.headroom import Holding, allowed
from contextpolicy.actuators.patches import cpu_for, resize_patch
from contextpolicy.actuators.pod_slot import PodSlot
from contextpolicy.cluster.claims import container_id
from contextpolicy.cluster.pods import ORIGINALS, Cpu, write_originals
from contextpolicy.errors import ActuationError
from contextpolicy.planning.policy import Control

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from concurrent.futures import Executor

    from reactivex.abc import SchedulerBase

    from contextpolicy.cluster.pods import ContainerView, Original, PodView

RETRY_FIRST, RETRY_LONGEST = 0.1, 5.0
"""Seconds before a failed patch is tried again: doubled with each failure. Only failures are ever retried by time."""


class Api(Protocol):
    """What the resizer needs of the API server."""

    def resize(self, namespace: str, pod: str, patch: Mapping[str, object]) -> int:
        """PATCH pods/resize; the generation of the accepted spec."""

    def annotate(self, namespace: str, pod: str, annotations: Mapping[str, str | None]) -> None:
        """Set or remove annotations."""


class Observer(Protocol):
    """Who wants to know how resizing goes; called on the loop's thread."""

    def on_accepted(self, policy: str, container: str, cpu: Cpu) -> None:
        """The API has the new resources."""

    def on_in_force(self, policy: str, container: str, limit: int) -> None:
        """The kubelet reports the limit that the plan wants."""

    def on_problem(self, policy: str, pod: str, error: ActuationError | None) -> None:
        """A patch failed, or after a failure works again (None)."""


@dataclass(frozen=True, slots=True)
class Order:
    """What one policy wants of its containers: shares per container and N per node, in thousandths of a core."""

    policy: str
    claimed: frozenset[str]
    shares: Mapping[str, int] = field(default_factory=dict)
    capacity: Mapping[str, int] = field(default_factory=dict)
    control: Control = Control.LIMIT
    ceilings: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class _Job:
    """One patch under way."""

    policy: str
    uid: str
    wanted: dict[str, Cpu]
    originals: Mapping[str, Original]


class PodResizer:
    """All pods that policies claim, and those that must be put back."""

    def __init__(self, api: Api, scheduler: SchedulerBase, workers: Executor, observer: Observer) -> None:
        self._api, self._scheduler, self._workers, self._observer = api, scheduler, workers, observer
        self._slots: dict[str, PodSlot] = {}
        self._orders: dict[str, Order] = {}
        self._released: dict[str, Callable[[], None]] = {}

    def apply(self, order: Order) -> None:
        """Let this be what the policy wants; replaces what it wanted before."""
        self._orders[order.policy] = order
        self._released.pop(order.policy, None)
        self._drive(order.policy)

    def release(self, policy: str, done: Callable[[], None]) -> None:
        """Put all containers of the policy back as they were, then call `done`."""
        self._orders[policy] = Order(policy, frozenset())
        self._released[policy] = done
        self._drive(policy)

    def observe(self, view: PodView) -> None:
        """Take a pod as the watch shows it."""
        slot = self._slots.get(view.uid)
        if slot is None:
            slot = self._slots[view.uid] = PodSlot(view)
        before = {c.name: c.actual for c in slot.view.containers}
        slot.observe(view)
        self._tell_in_force(slot, before)
        for policy in list(self._orders):
            self._drive(policy)

    def forget(self, uid: str) -> None:
        """The pod is gone."""
        if self._slots.pop(uid, None):
            for policy in list(self._orders):
                self._drive(policy)

    def _drive(self, policy: str) -> None:
        """Send every patch of the policy that may be sent now."""
        order = self._orders[policy]
        by_pod: dict[str, dict[str, Cpu]] = defaultdict(dict)
        for uid, name, cpu in self._steps(order):
            by_pod[uid][name] = cpu
        for slot in {id(slot): slot for slot, _, _ in self._claimed(order)}.values():
            wanted = by_pod.get(slot.view.uid)
            if slot.refused != wanted:
                slot.refused = None
            if wanted and not slot.busy and slot.refused is None:
                self._send(order, slot, wanted)
        for slot in list(self._slots.values()):
            self._restore(order, slot)
        self._finish_release(policy)

    def _steps(self, order: Order) -> Iterator[tuple[str, str, Cpu]]:
        """What differs from the plan and may be set now."""
        by_node: dict[str, list[tuple[PodSlot, ContainerView, Holding, Cpu]]] = defaultdict(list)
        for slot, container, share in self._claimed(order):
            cpu = self._cpu(order, slot, container, share)
            holding = Holding(f"{slot.view.uid}/{container.name}", slot.highest(container.name), cpu.limit or 0)
            by_node[slot.view.node].append((slot, container, holding, cpu))
        for node, claimed in by_node.items():
            bounded = order.control is not Control.WEIGHT
            limits = allowed(order.capacity.get(node, 0), [h for *_, h, _ in claimed]) if bounded else {}
            for slot, container, holding, cpu in claimed:
                rises = bounded and holding.wanted > holding.now and holding.id not in limits
                if cpu != slot.spec(container.name) and not rises:
                    yield slot.view.uid, container.name, cpu

    def _claimed(self, order: Order) -> Iterator[tuple[PodSlot, ContainerView, int]]:
        for slot in self._slots.values():
            for container in slot.view.containers:
                share = order.shares.get(container_id(slot.view, container.name))
                if share is not None and not slot.view.ended:
                    yield slot, container, share

    def _cpu(self, order: Order, slot: PodSlot, container: ContainerView, share: int) -> Cpu:
        ceiling = order.ceilings.get(container_id(slot.view, container.name), share)
        cpu = cpu_for(slot.view, container, share, order.control, ceiling)
        original = slot.view.originals.get(container.name)
        if original is None or order.control is not Control.LIMIT or slot.view.qos == "Guaranteed":
            return cpu
        return Cpu(original.cpu.request, cpu.limit)

    def _restore(self, order: Order, slot: PodSlot) -> None:
        """Put back the containers that the policy resized and no longer claims."""
        mine = {
            name: original.cpu
            for name, original in slot.view.originals.items()
            if original.policy == order.policy and container_id(slot.view, name) not in order.claimed
        }
        if mine and not slot.busy and not slot.view.ended and slot.refused != mine:
            self._send(order, slot, mine, restore=True)

    def _send(self, order: Order, slot: PodSlot, wanted: dict[str, Cpu], *, restore: bool = False) -> None:
        view = slot.view
        kept = (
            {name: original for name, original in view.originals.items() if name not in wanted}
            if restore
            else slot.originals(order.policy, set(wanted))
        )
        changed = {name: cpu for name, cpu in wanted.items() if slot.spec(name) != cpu}
        slot.sending(changed)

        def work() -> int:
            """The note of what was there is written before the first resize and taken away after the last."""
            if not restore and kept != view.originals:
                self._api.annotate(view.namespace, view.name, {ORIGINALS: write_originals(kept)})
            generation = self._api.resize(view.namespace, view.name, resize_patch(view, changed)) if changed else 0
            if restore:
                self._api.annotate(view.namespace, view.name, {ORIGINALS: write_originals(kept)})
            return generation

        job = _Job(order.policy, view.uid, wanted, kept)
        self._workers.submit(self._work, work, job)

    def _work(self, work: Callable[[], int], job: _Job) -> None:
        """On a worker's thread: the outcome goes back to the loop."""
        try:
            outcome: int | ActuationError = work()
        except ActuationError as error:
            outcome = error
        self._scheduler.schedule(lambda *_: self._finish(job, outcome))

    def _finish(self, job: _Job, outcome: int | ActuationError) -> None:
        slot = self._slots.get(job.uid)
        if slot is None:
            return
        if isinstance(outcome, ActuationError):
            self._fail(job.policy, slot, job.wanted, outcome)
            return
        if slot.attempts or slot.refused:
            self._observer.on_problem(job.policy, slot.view.name, None)
        slot.accepted(outcome, job.originals)
        for name, cpu in job.wanted.items():
            self._observer.on_accepted(job.policy, container_id(slot.view, name), cpu)
        if job.policy in self._orders:
            self._drive(job.policy)

    def _fail(self, policy: str, slot: PodSlot, wanted: dict[str, Cpu], error: ActuationError) -> None:
        slot.failed(wanted, retriable=error.retriable)
        if error.reason == "NotFound":
            self.forget(slot.view.uid)
            return
        self._observer.on_problem(policy, slot.view.name, error)
        if error.retriable:
            delay = min(RETRY_LONGEST, RETRY_FIRST * 2 ** min(slot.attempts - 1, 10))
            slot.busy = True
            self._scheduler.schedule_relative(delay, lambda *_: self._retry(policy, slot))

    def _retry(self, policy: str, slot: PodSlot) -> None:
        slot.busy = False
        if policy in self._orders:
            self._drive(policy)

    def _tell_in_force(self, slot: PodSlot, before: Mapping[str, Cpu | None]) -> None:
        for order in self._orders.values():
            for container in slot.view.containers:
                identity = container_id(slot.view, container.name)
                share = order.shares.get(identity)
                actual = container.actual
                if actual is None or share is None or actual == before.get(container.name):
                    continue
                if actual.limit == share:
                    self._observer.on_in_force(order.policy, identity, share)

    def _finish_release(self, policy: str) -> None:
        held = any(o.policy == policy for slot in self._slots.values() for o in slot.view.originals.values())
        if not held and policy in self._released:
            del self._orders[policy]
            self._released.pop(policy)()
