"""Everything alive in one operator: policies, pods and nodes come in from the watches; patches and reports go out.

Public methods may be called from any thread but the loop's: each hands its work to the loop and returns at once, except
`policy_changed`, `policy_deleted`, `connected` and `close`, which block.
"""

from __future__ import annotations

import logging
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

from contextpolicy.actuators.actuator import Actuators
from contextpolicy.actuators.dry_run import DryRun
from contextpolicy.actuators.following import SETTLED
from contextpolicy.actuators.idle import Idle
from contextpolicy.actuators.resize.resizer import PodResizer
from contextpolicy.actuators.resize.stored_originals import raw_of, stored_in
from contextpolicy.actuators.resize.vetting import Vetted, Vetting
from contextpolicy.bus.robot_bus import RobotBus
from contextpolicy.cluster.fencing import FencedApi
from contextpolicy.cluster.nodes import read_node
from contextpolicy.cluster.pod_parsing import version_of, view
from contextpolicy.policies.binder import Binder
from contextpolicy.policies.loader import load
from contextpolicy.policies.manager import PolicyManager
from contextpolicy.policies.queries import Queries
from contextpolicy.policies.registry import PolicyRegistry, reference_of
from contextpolicy.policies.shadows import Shadows
from contextpolicy.policies.status_publisher import StatusPublisher
from contextpolicy.policy.spec import Mode
from contextpolicy.recorder.flight_recorder import BUDGET, SECONDS, FlightRecorder
from contextpolicy.streams.loop import on_loop

if TYPE_CHECKING:
    from collections.abc import Mapping
    from concurrent.futures import Executor

    import zenoh

    from contextpolicy.actuators.resize.stored_originals import EntrySignatures
    from contextpolicy.bus.signatures import PlanSigner
    from contextpolicy.cluster.agent_reports import Confirmation
    from contextpolicy.cluster.fencing import Fence, PolicyApi
    from contextpolicy.cluster.pods import PodView
    from contextpolicy.policy.spec import Policy
    from contextpolicy.policy.tenants import Tenants
    from contextpolicy.streams.loop import Loop
    from contextpolicy.streams.wall_clock import WallClock

log = logging.getLogger(__name__)


class Operator:
    """The operator without its watches.

    The `clock` gives the times that people read. `api` is written to only where the `fence` lets us act. `patches`
    sends resizes; `reports` writes statuses and events and must have one thread, which keeps them in order. `close`
    shuts both down. `agents_everywhere` says that every node with tasks is to have a node agent. A plan that has stayed
    the same for `settled` seconds follows from an agent to the API.
    """

    def __init__(  # noqa: PLR0913 - what an operator is made of
        self,
        api: PolicyApi,
        fence: Fence,
        loop: Loop,
        *,
        patches: Executor,
        reports: Executor,
        signer: PlanSigner,
        signatures: EntrySignatures,
        tenants: Tenants,
        clock: WallClock,
        agents_everywhere: bool = False,
        settled: float = SETTLED,
    ) -> None:
        self._api, self._loop, self._patches = FencedApi(api, fence), loop, patches
        self._tenants = tenants
        registry, recorder = PolicyRegistry(), FlightRecorder(BUDGET, SECONDS)
        shadows = Shadows(registry)
        self._bus = RobotBus(loop, self)
        self._publisher = StatusPublisher(
            self._api, loop, reports, registry, bus=self._bus, shadows=shadows, clock=clock
        )
        self._vetting = Vetting(signatures, self._api)
        self._resizer = PodResizer(self._api, loop, patches, self._publisher.resizes, signatures)
        self._originals = self._resizer.originals
        self._actuators = Actuators({Mode.ENFORCE: self._resizer, Mode.DRY_RUN: DryRun(), Mode.PAUSED: Idle()})
        self._binder = Binder(
            loop,
            registry,
            self._bus,
            self._publisher,
            originals=self._originals,
            contests=self._resizer.contests,
            tenants=self._tenants,
        )
        self.queries = Queries(
            loop,
            registry,
            self._bus,
            pods=self._binder.pods,
            nodes=self._binder.nodes,
            resizes=self._publisher.resizes,
            recorder=recorder,
            clock=clock,
            agents_everywhere=agents_everywhere,
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
            clock=clock,
            settled=settled,
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
        self._bus.open(session)

    def on_session(self) -> None:
        """There is a session: start the policies that waited for it."""
        self._policies.begin()

    def on_agents(self) -> None:
        """An agent's report has changed, and with it what policies can count on."""
        self._binder.place()

    def on_confirmation(self, node: str, said: Confirmation) -> None:
        """A node's agent has carried out a plan: what it wrote is in force."""
        self._publisher.on_confirmation(node, said)

    def on_trial(self, node: str) -> None:
        """A node's agent has yet to confirm a plan before policies can count on it."""
        self._policies.repeat_to(node)

    def on_router(self) -> None:
        """The router connected or disconnected, which every status reports."""
        self._publisher.report_all()

    @property
    def has_router(self) -> bool:
        """Whether a Zenoh router is connected."""
        return self._bus.connected

    def policy_changed(self, body: Mapping[str, Any]) -> Future[bool]:
        """A ContextPolicy is new, was edited or already existed; the result says whether all it names could be read.

        Reads on the caller's thread, which may take a second.
        """
        loaded = load(body, self._api, self._tenants)
        vetted = self._vet(body, loaded.policy)
        return on_loop(self._loop, lambda: self._policies.adopt(body, loaded, vetted))

    def policy_deleted(self, body: Mapping[str, Any]) -> Future[None]:
        """A ContextPolicy is being deleted; the future is done when every container is restored.

        Reads on the caller's thread, which may take a second.
        """
        done: Future[None] = Future()
        vetted = self._vet(body, None)
        on_loop(self._loop, lambda: self._policies.drop(body, vetted, done))
        return done

    def policy_seen(self, body: Mapping[str, Any]) -> None:
        """A ContextPolicy as the watch shows it, after any change: only we may change its originals."""
        raw, version = raw_of(body), version_of(body["metadata"])
        on_loop(self._loop, lambda: self._resizer.inspect(reference_of(body), raw, version))

    def policy_gone(self, uid: str) -> None:
        """The object of a ContextPolicy is gone, released or not."""
        on_loop(self._loop, lambda: self._policies.lose(uid))

    def abandon(self, namespace: str) -> None:
        """Another operator serves this namespace now: forget its policies, and change nothing."""
        on_loop(self._loop, lambda: self._policies.abandon(namespace))

    def resume(self) -> None:
        """We may act again after an interruption in which no other replica did: publish again what is in force."""
        on_loop(self._loop, self._policies.repeat)

    def pod_changed(self, pod: Mapping[str, Any]) -> None:
        """A pod is new or has changed; one that can't be parsed is logged and ignored."""
        try:
            seen = view(pod)
        except ValueError as error:
            log.warning("ignoring a pod that can't be parsed: %s: %.200r", error, pod)
            return
        self._vetting.observe(seen)
        on_loop(self._loop, lambda: self._take_pod(seen))

    def pod_gone(self, uid: str) -> None:
        """A pod was deleted."""
        self._vetting.forget(uid)
        on_loop(self._loop, lambda: self._lose_pod(uid))

    def node_changed(self, node: Mapping[str, Any]) -> None:
        """A node is new or has changed; only its allocatable CPU and its kubelet's version matter."""
        uid, seen = node["metadata"]["uid"], read_node(node)
        if seen is not None:
            on_loop(self._loop, lambda: self._binder.take_node(uid, seen))

    def node_gone(self, uid: str) -> None:
        """A node was deleted."""
        on_loop(self._loop, lambda: self._binder.lose_node(uid))

    def _vet(self, body: Mapping[str, Any], policy: Policy | None) -> Vetted:
        """What a policy's status says about an earlier operator's work; of no interest once the policy is known."""
        if self._originals.knows(reference_of(body)):
            return Vetted(stored_in(body))
        return self._vetting.vet(body, policy or load(body, self._api, self._tenants).policy)

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
