"""Make plans real by resizing pods in place (KEP-1287): decreases first, the latest plan wins, originals are kept.

Level-triggered: `apply` states what should be, `observe` what is, and every difference becomes a patch. All methods run
on the loop's thread; patches run on workers and report back to it.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Any

from reactivex.disposable import Disposable, SerialDisposable

from contextpolicy.actuators.order import Order
from contextpolicy.actuators.resize.background import Background
from contextpolicy.actuators.resize.contests import Contests
from contextpolicy.actuators.resize.dispatcher import Dispatcher
from contextpolicy.actuators.resize.originals import Originals
from contextpolicy.actuators.resize.pod_index import PodIndex
from contextpolicy.actuators.resize.pod_state import Phase
from contextpolicy.actuators.resize.reconciler import Reconciler
from contextpolicy.actuators.resize.status_record import StatusRecord
from contextpolicy.actuators.resize.targets import target_cpu
from contextpolicy.cluster.container_names import container_id

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from concurrent.futures import Executor

    from reactivex.abc import SchedulerBase

    from contextpolicy.actuators.resize.dispatcher import Observer
    from contextpolicy.actuators.resize.pod_patch import ResizeApi
    from contextpolicy.actuators.resize.stored_originals import EntrySignatures, StoredOriginals
    from contextpolicy.actuators.resize.tracked_pod import TrackedPod
    from contextpolicy.cluster.pods import Cpu, PodView

ROUNDING = 1e-3
"""Seconds that a timer fires late on purpose: times are floats, and one that fired early would find nothing due."""

BOOKKEEPING = 0.1
"""Seconds after which a policy is looked at because of news that let it send nothing more. A pass looks at all of its
containers: one for each of their answers and status updates would cost the square of their number."""


NO_TIMER = Disposable()
"""Takes the place of a timer that is not needed."""


class PodResizer:
    """All pods that policies claim, and those that must be restored."""

    def __init__(
        self,
        api: ResizeApi,
        scheduler: SchedulerBase,
        workers: Executor,
        observer: Observer,
        signatures: EntrySignatures,
    ) -> None:
        self.originals, self.contests = Originals(signatures), Contests()
        self._scheduler, self._observer = scheduler, observer
        self._pods = PodIndex()
        self._reconcilers: dict[str, Reconciler] = {}
        self._released: dict[str, Callable[[], None]] = {}
        """What to call once a policy is released."""
        background = Background(scheduler, workers)
        self._now = background.now
        self._dispatcher = Dispatcher(self.originals, self._pods, api, background, observer, listener=self)
        self._record = StatusRecord(self.originals, api, background, observer, self)
        self._dirty: set[str] = set()
        self._later: set[str] = set()
        self._timer = SerialDisposable()

    def recall(self, policy: str, stored: StoredOriginals) -> None:
        """Load the originals from a policy's status, when the policy first appears.

        Entries for pods outside the policy's own namespace are ignored.
        """
        namespace = policy.partition("/")[0]
        self.originals.recall(policy, stored, lambda uid: self._pods.belongs_to(uid, namespace))

    def inspect(self, policy: str, raw: Mapping[str, Any], version: int) -> None:
        """Compare the originals in a policy's status, as the watch shows it, with what they should be."""
        if self._record.inspect(policy, raw, version):
            self._mark_dirty([policy])

    def apply(self, order: Order) -> None:
        """Replace what the policy wants, and start to make it real."""
        self._released.pop(order.policy, None)
        self._reconciler(order.policy).follow(order)
        self._reconcile([order.policy])

    def release(self, policy: str, done: Callable[[], None]) -> None:
        """Restore all containers of the policy, then call `done`; calling again retries at once what was refused."""
        self._released[policy] = done
        self._reconciler(policy).release()
        self._reconcile([policy])

    def abandon(self, policy: str) -> None:
        """Forget a policy and its pods without restoring anything: another operator serves its namespace now."""
        self._released.pop(policy, None)
        if self._reconcilers.pop(policy, None) is not None:
            namespace = policy.partition("/")[0]
            self._pods.renew(namespace)
            self.contests.abandon(namespace)
        self._record.forget(policy)

    def observe(self, view: PodView) -> None:
        """Process a pod as the watch shows it."""
        known = self._pods.knows(view.uid)
        pod = self._pods.get(view)
        standing = pod.standing if known else None
        before = {container.name: container.actual for container in pod.view.containers}
        pod.observe(view, self._now())
        self._tell_in_force(pod, before)
        if pod.standing == standing:
            self._mark_if_awaited(pod)
        else:
            self._mark(pod)

    def forget(self, uid: str) -> None:
        """The pod is gone."""
        pod = self._pods.pop(uid)
        if pod is not None:
            self._mark(pod)
            for reconciler in self._reconcilers.values():
                reconciler.forget(pod)
            self.originals.drop_pod(uid)
            self.contests.forget(uid)

    def on_patch_end(self, pod: TrackedPod) -> None:
        """A patch has ended; the API server may have no such pod any more."""
        if pod.state.phase is Phase.GONE:
            self.forget(pod.uid)
        else:
            self._mark_if_awaited(pod)

    def on_record_end(self, policy: str) -> None:
        """The policy's status has its originals, or the write failed: see what can be sent now."""
        self._mark_dirty([policy])

    def _reconciler(self, policy: str) -> Reconciler:
        reconciler = self._reconcilers.get(policy)
        if reconciler is None:
            nothing = Order(policy, frozenset())
            reconciler = Reconciler(
                nothing, self._pods, self.originals, self._dispatcher, self._observer, contests=self.contests
            )
            self._reconcilers[policy] = reconciler
        return reconciler

    def _concerned(self, pod: TrackedPod) -> list[str]:
        """All policies that a change of this pod may matter to: policies share pods, and one may wait for another."""
        return [policy for policy, reconciler in self._reconcilers.items() if reconciler.concerns(pod)]

    def _mark(self, pod: TrackedPod) -> None:
        self._mark_dirty(self._concerned(pod))

    def _mark_if_awaited(self, pod: TrackedPod) -> None:
        """Schedule a pass over the policies that have more to send to the pod; over the others one for bookkeeping."""
        concerned = self._concerned(pod)
        self._mark_dirty(policy for policy in concerned if self._reconcilers[policy].awaits(pod))
        idle = not self._later
        self._later.update(concerned)
        if idle and self._later:
            self._scheduler.schedule_relative(BOOKKEEPING, lambda *_: self._reconcile(self._later))

    def _mark_dirty(self, policies: Iterable[str]) -> None:
        """Schedule one pass over the policies, so that thirty answers that arrive together cost one pass."""
        idle = not self._dirty
        self._dirty.update(policies)
        if idle and self._dirty:
            self._scheduler.schedule(lambda *_: self._reconcile(()))

    def _reconcile(self, policies: Iterable[str]) -> None:
        """Send every patch that may be sent now, for these policies and all that are marked dirty."""
        marked, self._dirty = self._dirty.union(policies), set()
        self._later -= marked
        now = self._now()
        for policy in marked - self._reconcilers.keys():
            self._write_later(policy, self._record.write(policy, now))
        for policy in sorted(marked & self._reconcilers.keys()):
            reconciler = self._reconcilers[policy]
            reconciler.reconcile(now)
            if policy in self._released and reconciler.is_released():
                del self._reconcilers[policy]
                self._record.forget(policy)
                self._released.pop(policy)()
            else:
                reconciler.again = min(reconciler.again, self._record.write(policy, now))
        self._arm(now)

    def _write_later(self, policy: str, due: float) -> None:
        """Call again when the status of a policy that wants nothing yet may be written."""
        if due < inf:
            wait = max(0.0, due - self._now()) + ROUNDING
            self._scheduler.schedule_relative(wait, lambda *_: self._reconcile([policy]))

    def _arm(self, now: float) -> None:
        """One timer for all policies, for the earliest time at which any of them may have something to do."""
        due = min([reconciler.again for reconciler in self._reconcilers.values()], default=inf)
        if due == inf:
            self._timer.disposable = NO_TIMER
        else:
            wait = max(0.0, due - now) + ROUNDING
            self._timer.disposable = self._scheduler.schedule_relative(wait, lambda *_: self._on_timer())

    def _on_timer(self) -> None:
        now = self._now()
        self._reconcile([policy for policy, reconciler in self._reconcilers.items() if reconciler.again <= now])

    def _tell_in_force(self, pod: TrackedPod, before: Mapping[str, Cpu | None]) -> None:
        news = [c for c in pod.view.containers if c.actual is not None and c.actual != before.get(c.name)]
        for policy in self._concerned(pod) if news else ():
            order = self._reconcilers[policy].order
            for container in news:
                identity = container_id(pod.view, container.name)
                if identity in order.shares and container.actual is not None:
                    original = self.originals.at(pod.uid, container.name)
                    wanted = target_cpu(order, identity, pod, container, original)
                    same = container.actual.limit == wanted.limit
                    if same and (identity not in order.requests or container.actual == wanted):
                        self._observer.on_in_force(policy, identity, order.shares[identity])
