"""Everything alive in one operator: policies, pods and nodes come in from the watches; patches and reports go out.

Public methods may be called from any thread but the loop's: each hands its work to the loop and returns at once, except
`policy_changed`, `connected` and `close`, which block.
"""

from __future__ import annotations

import logging
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

from contextpolicy.actuators.actuator import Actuators
from contextpolicy.actuators.dry_run import DryRun
from contextpolicy.actuators.resize.resizer import PodResizer
from contextpolicy.bus.robot_bus import RobotBus
from contextpolicy.cluster.fencing import FencedApi
from contextpolicy.cluster.nodes import allocatable
from contextpolicy.cluster.pods import view
from contextpolicy.policies.binder import Binder
from contextpolicy.policies.loader import load
from contextpolicy.policies.manager import PolicyManager
from contextpolicy.policies.queries import Queries
from contextpolicy.policies.registry import PolicyRegistry
from contextpolicy.policies.shadows import Shadows
from contextpolicy.policies.status_publisher import StatusPublisher
from contextpolicy.policy.spec import Mode
from contextpolicy.policy.tenants import Tenants
from contextpolicy.recorder.flight_recorder import FlightRecorder
from contextpolicy.streams.loop import on_loop

if TYPE_CHECKING:
    from collections.abc import Mapping
    from concurrent.futures import Executor

    import zenoh

    from contextpolicy.bus.signatures import Signer
    from contextpolicy.cluster.fencing import Fence, PolicyApi
    from contextpolicy.cluster.pods import PodView
    from contextpolicy.streams.loop import Loop

log = logging.getLogger(__name__)


class Operator:
    """The operator without its watches.

    `api` is written to only where the `fence` lets us act. `patches` sends resizes; `reports` writes statuses and
    events and must have one thread, which keeps them in order. `close` shuts both down.
    """

    def __init__(  # noqa: PLR0913 - what an operator is made of
        self,
        api: PolicyApi,
        fence: Fence,
        loop: Loop,
        *,
        patches: Executor,
        reports: Executor,
        signer: Signer | None = None,
        tenants: Tenants | None = None,
    ) -> None:
        self._api, self._loop, self._patches = FencedApi(api, fence), loop, patches
        self._tenants = tenants or Tenants()
        registry, recorder = PolicyRegistry(), FlightRecorder()
        shadows = Shadows(registry)
        self._bus = RobotBus(loop)
        self._publisher = StatusPublisher(self._api, loop, reports, registry, bus=self._bus, shadows=shadows)
        resizer = PodResizer(self._api, loop, patches, self._publisher.resizes)
        self._originals = resizer.originals
        self._actuators = Actuators({Mode.ENFORCE: resizer, Mode.DRY_RUN: DryRun()})
        self._binder = Binder(
            loop, registry, self._bus, self._publisher, originals=self._originals, tenants=self._tenants
        )
        self.queries = Queries(
            loop, registry, self._bus, pods=self._binder.pods, resizes=self._publisher.resizes, recorder=recorder
        )
        self._policies = PolicyManager(
            loop,
            registry,
            self._bus,
            actuators=self._actuators,
            publisher=self._publisher,
            binder=self._binder,
            queries=self.queries,
            shadows=shadows,
            recorder=recorder,
            fence=fence,
            signer=signer,
        )

    def close(self) -> None:
        """Stop; limits stay in force, as after a crash, and the next start goes on from there."""
        self._bus.stop()
        on_loop(self._loop, self._policies.stop).result(timeout=5)
        self._loop.dispose()
        self._patches.shutdown(wait=True, cancel_futures=True)
        self._publisher.close()
        self._bus.close()

    def connected(self, session: zenoh.Session) -> None:
        """The session to the robot's bus is open: start the policies that waited for it. Blocks up to a second."""
        self._bus.open(session, self)

    def on_session(self) -> None:
        """There is a session: start the policies that waited for it."""
        self._policies.begin()

    def on_agents(self) -> None:
        """An agent's report has changed, and with it what policies can count on."""
        self._binder.place()

    def on_router(self) -> None:
        """The router came or went: every status has that."""
        self._publisher.report_all()

    @property
    def has_router(self) -> bool:
        """Whether the bus is there."""
        return self._bus.connected

    def policy_changed(self, body: Mapping[str, Any]) -> Future[bool]:
        """A ContextPolicy is new, was edited or already existed; the result says whether all it names could be read.

        Reads on the caller's thread, which may take a second.
        """
        loaded = load(body, self._api, self._tenants)
        return on_loop(self._loop, lambda: self._policies.adopt(body, loaded))

    def policy_deleted(self, body: Mapping[str, Any]) -> Future[None]:
        """A ContextPolicy is being deleted; the future is done when every container is restored."""
        done: Future[None] = Future()
        on_loop(self._loop, lambda: self._policies.drop(body, done))
        return done

    def abandon(self, namespace: str) -> None:
        """Another operator serves this namespace now: forget its policies, and change nothing."""
        on_loop(self._loop, lambda: self._policies.abandon(namespace))

    def resume(self) -> None:
        """We may act again after an interruption, and nobody else did meanwhile: say again what is in force."""
        on_loop(self._loop, self._policies.repeat)

    def pod_changed(self, pod: Mapping[str, Any]) -> None:
        """A pod is new or has changed; one that can't be parsed is logged and ignored."""
        try:
            seen = view(pod)
        except ValueError as error:
            log.warning("a pod can't be read: %s: %.200r", error, pod)
            return
        on_loop(self._loop, lambda: self._take_pod(seen))

    def pod_gone(self, uid: str) -> None:
        """A pod was deleted."""
        on_loop(self._loop, lambda: self._lose_pod(uid))

    def node_changed(self, node: Mapping[str, Any]) -> None:
        """A node is new or has changed; only its allocatable CPU matters."""
        uid, name, cpu = node["metadata"]["uid"], node["metadata"]["name"], allocatable(node)
        if cpu is not None:
            on_loop(self._loop, lambda: self._binder.take_node(uid, name, cpu))

    def node_gone(self, uid: str) -> None:
        """A node was deleted."""
        on_loop(self._loop, lambda: self._binder.lose_node(uid))

    def _take_pod(self, pod: PodView) -> None:
        self._binder.take_pod(pod)
        resized = self._originals.in_pod(pod.uid)
        self._publisher.resizes.observe(pod, {original.policy for original in resized.values()})
        self._actuators.observe(pod)

    def _lose_pod(self, uid: str) -> None:
        pod = self._binder.lose_pod(uid)
        if pod is not None:
            self._publisher.resizes.lose(pod)
            self._actuators.forget(uid)
