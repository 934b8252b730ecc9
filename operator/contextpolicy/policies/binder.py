"""Where everything runs: gives each policy's runner its containers and its nodes' capacity."""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING

from contextpolicy.cluster.agent_reports import unwritten, with_agents, writing
from contextpolicy.cluster.claims import claim
from contextpolicy.cluster.container_names import container_id
from contextpolicy.cluster.pod_directory import PodDirectory
from contextpolicy.cluster.room import demand
from contextpolicy.cluster.weight_bounds import granted
from contextpolicy.policies.handover import Holdings, givers_first

if TYPE_CHECKING:
    from collections.abc import Sequence

    from contextpolicy.actuators.resize.contests import Contests
    from contextpolicy.actuators.resize.originals import Originals
    from contextpolicy.bus.robot_bus import RobotBus
    from contextpolicy.cluster.claims import Claim
    from contextpolicy.cluster.nodes import NodeView
    from contextpolicy.cluster.pods import PodView
    from contextpolicy.policies.policy_runner import PolicyRunner
    from contextpolicy.policies.registry import PolicyRegistry
    from contextpolicy.policies.status_publisher import StatusPublisher
    from contextpolicy.policy.spec import Policy
    from contextpolicy.policy.tenants import Tenants
    from contextpolicy.streams.loop import Loop


class Binder:
    """Knows all pods and nodes, everything on the loop's thread.

    `originals` are what containers had before us, `contests` the limits that others insist on.
    """

    def __init__(  # noqa: PLR0913 - all that a claim depends on
        self,
        loop: Loop,
        registry: PolicyRegistry,
        bus: RobotBus,
        publisher: StatusPublisher,
        *,
        originals: Originals,
        contests: Contests,
        tenants: Tenants,
    ) -> None:
        self.pods = PodDirectory()
        self._loop, self._registry, self._bus, self._publisher = loop, registry, bus, publisher
        self._originals, self._contests, self._tenants = originals, contests, tenants
        self.nodes: dict[str, NodeView] = {}
        """By UID: a recreated one may be listed before the old one is gone."""
        self._moved: set[str] = set()
        """Namespaces whose pods came, went or moved since the last placement."""
        self._elsewhere: dict[str, tuple[int, int]] = {}
        """What pods of namespaces without policies request, and are granted, where that decides about any policy."""
        self._owned: dict[str, frozenset[str]] = {}
        """The containers of each policy at the last placement, also of one that has been edited since."""
        contests.changes.subscribe(self._move)

    def take_pod(self, pod: PodView) -> None:
        """A pod is new or has changed."""
        before = self.pods.put(pod)
        if before is None or self._seat(before) != self._seat(pod):
            self._move(pod.namespace)

    def lose_pod(self, uid: str) -> PodView | None:
        """A pod was deleted; returns its last view, None if it is unknown."""
        pod = self.pods.pop(uid)
        if pod is not None:
            self._move(pod.namespace)
        return pod

    def take_node(self, uid: str, node: NodeView) -> None:
        """A node is new or has changed."""
        if self.nodes.get(uid) != node:
            self.nodes[uid] = node
            self._bus.take_node(node.name)
            self.place()

    def lose_node(self, uid: str) -> None:
        """A node was deleted. Placing waits for the loop's next turn, as a node of the same name may follow at once."""
        lost = self.nodes.pop(uid, None)
        if lost is not None:
            if lost.name not in {node.name for node in self.nodes.values()}:
                self._bus.lose_node(lost.name)
            self._loop.schedule(lambda *_: self.place())

    def place(self) -> None:
        """Give all runners what they may claim."""
        claims = self._claims()
        self._moved = set()
        self._give_all(claims)

    def _place_moved(self) -> None:
        """Update the runners that pods of the moved namespaces concern."""
        moved, self._moved = self._moved, set()
        if moved & self._registry.namespaces() or self._is_room_changed():
            self._give_all(
                [
                    (runner, own)
                    for runner, own in self._claims()
                    if runner.policy.namespace in moved or own != runner.claim
                ]
            )

    def _claims(self) -> list[tuple[PolicyRunner, Claim]]:
        runners = self._registry.runners()
        policies = [runner.policy for runner in runners]
        namespaces = {policy.namespace for policy in policies}
        pods = chain.from_iterable(self.pods.of(namespace) for namespace in namespaces)
        nodes, agents = {node.name: node.cpu for node in self.nodes.values()}, writing(self._bus.reports)
        elsewhere, weighing = self.pods.requested(but=namespaces), self.pods.granted(but=namespaces)
        claims = claim(
            policies,
            pods,
            nodes,
            self._originals.cpu,
            self._tenants,
            agents=agents,
            elsewhere=elsewhere,
            weighing=weighing,
            doubt=self._originals.doubt,
            left=self._contests.left,
        )
        self._elsewhere = {
            node: (elsewhere.get(node, 0), weighing.get(node, 0))
            for own in claims.values()
            for node in (*own.room, *own.most_weight)
        }
        return [
            (runner, self._with_agents(policy, claims[policy.reference]))
            for runner, policy in zip(runners, policies, strict=True)
        ]

    def _is_room_changed(self) -> bool:
        if not self._elsewhere:
            return False
        namespaces = {runner.policy.namespace for runner in self._registry.runners()}
        requested, weighing = self.pods.requested(but=namespaces), self.pods.granted(but=namespaces)
        return any(
            (requested.get(node, 0), weighing.get(node, 0)) != before for node, before in self._elsewhere.items()
        )

    def _with_agents(self, policy: Policy, found: Claim) -> Claim:
        own = with_agents(policy, found, self._bus.reports)
        failures = self._bus.failures(policy.reference)
        if failures:
            own.unlimited.extend(unwritten(policy, failures, self.pods.of(policy.namespace)))
        return own

    def _give_all(self, claims: Sequence[tuple[PolicyRunner, Claim]]) -> None:
        """Give these runners what they may claim; of two policies between which a container moves, its owner first."""
        found = {runner.policy.reference: (runner, own) for runner, own in claims}
        now = {reference: _containers(*given) for reference, given in found.items()}
        handover = givers_first({one: Holdings(self._owned.get(one, frozenset()), now[one]) for one in found})
        present = {runner.policy.reference for runner in self._registry.runners()}
        self._owned = {one: owned for one, owned in (self._owned | now).items() if one in present}
        for reference in handover.order:
            self._give(*found[reference])
        for reference in handover.again:
            found[reference][0].publisher.publish_again()

    def _give(self, runner: PolicyRunner, own: Claim) -> None:
        policy = runner.policy
        self._publisher.emit_claim(policy.reference, runner.claim, own)
        runner.place(own, self.pods.of(policy.namespace))

    def _move(self, namespace: str) -> None:
        """Schedule one placement, so that a list of thousands of pods costs one and not thousands."""
        idle = not self._moved
        self._moved.add(namespace)
        if idle:
            self._loop.schedule(lambda *_: self._place_moved())

    def _seat(self, pod: PodView) -> tuple[object, ...]:
        """The parts of a pod that claims depend on: a mere status update must not cost a new placement."""
        original = self._originals.cpu
        bounds = tuple(
            (c.name, before, pod.floor(c, before), c.memory_limit, c.container_id)
            for c in pod.containers
            for before in [original(pod.uid, c.name) or c.spec]
        )
        before = {
            container_id(pod, c.name): cpu.request or 0 for c in pod.containers if (cpu := original(pod.uid, c.name))
        }
        weighs = granted(pod, before)
        return pod.node, pod.labels, pod.qos, pod.ended, pod.mirror, pod.limit, bounds, demand(pod, original), weighs


def _containers(runner: PolicyRunner, own: Claim) -> frozenset[str]:
    """The containers that agents take for the policy's."""
    return frozenset(one.id for one in own.placement.containers) if runner.policy.mode.acts else frozenset()
