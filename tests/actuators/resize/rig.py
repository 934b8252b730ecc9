"""A resizer at work on a fake cluster: patches run, and the watch reports, when the test says so."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from reactivex.testing import TestScheduler

from contextpolicy.actuators.order import Order
from contextpolicy.actuators.resize import status_record
from contextpolicy.actuators.resize.resizer import PodResizer
from contextpolicy.actuators.resize.stored_originals import StoredOriginals, UnsignedOriginals, raw_of, read, stored_in
from contextpolicy.cluster.pod_parsing import version_of, view
from contextpolicy.policy.spec import Control
from tests.actuators.resize.fake_cluster import FakeCluster, Killed
from tests.cluster.builders import NODE, a_pod, cpu

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from contextpolicy.actuators.resize.conflict import Conflict
    from contextpolicy.cluster.pods import Cpu
    from contextpolicy.errors import ActuationError

POLICY, OTHER = "lab/robot", "lab/other"
MOMENT = 1e-5
"""Seconds in which everything due happens."""


class Workers:
    """Holds patches back until they are let go; apart from them, if wanted, what writes to a policy's status."""

    def __init__(self, *, apart: bool) -> None:
        self.jobs: list[Callable[[], object]] = []
        self.writes: list[Callable[[], object]] = []
        self._apart = apart

    def submit(self, act: Callable[..., object], *arguments: Any) -> None:
        apart = self._apart and arguments[0].__module__ == status_record.__name__
        (self.writes if apart else self.jobs).append(lambda: act(*arguments))

    def run(self, index: int = 0) -> None:
        self.jobs.pop(index)()


class Witness:
    """Notes what the resizer reports."""

    def __init__(self) -> None:
        self.accepted: list[tuple[str, int | None]] = []
        self.in_force: list[tuple[str, int]] = []
        self.problems: list[tuple[str, str, str]] = []
        self.conflicts: list[tuple[str, object]] = []
        self.changed_by_others: list[str] = []

    def on_accepted(self, policy: str, container: str, cpu: Cpu, answered: float) -> None:  # noqa: ARG002 - its signature
        self.accepted.append((container, cpu.limit))

    def on_in_force(self, policy: str, container: str, limit: int) -> None:  # noqa: ARG002 - as above
        self.in_force.append((container, limit))

    def on_problem(self, policy: str, subject: str, error: ActuationError | None) -> None:
        self.problems.append((policy, subject, error.reason if error else "recovered"))

    def on_conflict(self, policy: str, container: str, conflict: Conflict | None) -> None:  # noqa: ARG002 - as above
        limits = (conflict.by, conflict.had.limit, conflict.got.limit) if conflict else "over"
        self.conflicts.append((container, limits))

    def on_changed_by_other(self, policy: str) -> None:
        self.changed_by_others.append(policy)


class Rig:
    """One operator's resizer; `kill` ends it and starts the next one from what the API server has.

    Originals are stored at once, unless `stores` says that it is work like any other.
    """

    def __init__(self, *pods: dict[str, Any], stores: bool = False, **kubelet: bool) -> None:
        self.cluster = FakeCluster(*pods, **kubelet)
        self._apart = not stores
        self.scheduler = TestScheduler()
        self.released: list[str] = []
        self.kill()

    def kill(self) -> None:
        self.scheduler = TestScheduler()
        self.workers, self.witness = Workers(apart=self._apart), Witness()
        self.resizer = PodResizer(self.cluster, self.scheduler, self.workers, self.witness, UnsignedOriginals())  # type: ignore[arg-type]
        for uid, feed in self.cluster.feeds.items():
            feed.clear()
            self.resizer.observe(view(self.cluster.pods[uid]))
        for policy in self.cluster.policies:
            self.resizer.recall(policy, believed(self.cluster.policy(policy)))

    def plan(self, policy: str = POLICY, *, n: int = 1000, control: Control = Control.LIMIT, **shares: int) -> None:
        """Shares by container; a container is in the pod of its name unless it is written pod__container."""
        self.order(policy, by_id(shares), n=n, control=control)

    def enforce(self, policy: str = POLICY, **plan: Any) -> None:
        """Let everybody carry a plan out."""
        self.plan(policy, **plan)
        self.settle()

    def hold(self, policy: str, **shares: int) -> None:
        """Claim these containers and want nothing of them."""
        self.apply(Order(policy, frozenset(by_id(shares))))

    def order(
        self,
        policy: str,
        shares: Mapping[str, int],
        *,
        n: int = 1000,
        control: Control = Control.LIMIT,
    ) -> None:
        weighted, nodes = control is Control.WEIGHT, dict.fromkeys(shares, NODE)
        limits = dict.fromkeys(shares, 800) if weighted else dict(shares)
        requests = dict(shares) if weighted else {}
        self.apply(Order(policy, frozenset(shares), dict(shares), {NODE: n}, limits, requests, not weighted, nodes))

    def apply(self, order: Order) -> None:
        """The policy exists and wants this."""
        self.cluster.policies.setdefault(order.policy, {})
        self.resizer.apply(order)
        self.store()

    def release(self, policy: str = POLICY) -> None:
        """The policy is deleted: its object goes as soon as its containers are back."""
        self.resizer.release(policy, lambda: self._gone(policy))

    def _gone(self, policy: str) -> None:
        self.released.append(policy)
        self.cluster.policies.pop(policy, None)

    def work(self, index: int = 0) -> None:
        """Run one patch and let the loop hear of it."""
        self.workers.run(index)
        self.wait(MOMENT)

    def watch(self, *uids: str) -> None:
        """Let the watch report everything that it has, one version after the other."""
        for uid in uids or tuple(self.cluster.feeds):
            while self.cluster.feeds[uid]:
                self.watch_one(uid)

    def watch_one(self, uid: str) -> None:
        self.resizer.observe(view(self.cluster.feeds[uid].popleft()))
        self.wait(MOMENT)

    def show(self) -> None:
        """Let the watch show the policy's status as it is now."""
        body = self.cluster.policy(POLICY)
        self.resizer.inspect(POLICY, raw_of(body), version_of(body["metadata"]))
        self.wait(MOMENT)

    def remove(self, uid: str) -> None:
        self.cluster.remove(uid)
        self.resizer.forget(uid)
        self.wait(MOMENT)

    def wait(self, seconds: float) -> None:
        self.scheduler.advance_by(seconds)
        self.store()

    def store(self) -> None:
        """Let what is to be written to statuses be written."""
        while self.workers.writes:
            self.workers.writes.pop(0)()
            self.scheduler.advance_by(MOMENT)

    def settle(self) -> None:
        """Let everybody do all that there is to do."""
        for _ in range(100):
            while self.workers.jobs:
                self.work()
            self.cluster.confirm()
            self.watch()
            self.wait(10.0)
            if not self.workers.jobs:
                return
        raise AssertionError(f"never settles; last calls: {self.cluster.calls[-6:]}")

    def survive(self, act: Callable[[], object]) -> bool:
        """Whether the operator lives through `act`; if not, the next one starts."""
        try:
            act()
        except Killed:
            self.kill()
            return False
        return True


def believed(body: dict[str, Any]) -> StoredOriginals:
    """What an object's status says, taken for true."""
    return replace(stored_in(body), pods=dict(read("", raw_of(body))))


def by_id(shares: Mapping[str, int]) -> dict[str, int]:
    """A test's short names (`slam`, `slam__map`) as the names that planning uses."""
    return {f"lab/{name.partition('__')[0]}/{name.rpartition('__')[2]}": share for name, share in shares.items()}


def two_pods(**kubelet: bool) -> Rig:
    """slam and speech, each with a limit of 500m."""
    return Rig(a_pod("slam"), a_pod("speech"), **kubelet)


def one_pod_for_two() -> Rig:
    """slam and map in one pod, each with a limit of 500m."""
    return Rig(a_pod("slam", {"slam": cpu("100m", "500m"), "map": cpu("100m", "500m")}))


def limits(rig: Rig) -> tuple[int, int]:
    """What the API has for slam and speech."""
    return rig.cluster.limit("slam"), rig.cluster.limit("speech")
