"""How one policy gets what it wants: finds every difference from what is, and sends what may be sent now."""

from __future__ import annotations

from collections import defaultdict
from functools import partial
from math import inf
from typing import TYPE_CHECKING

from contextpolicy.actuators.order import Order
from contextpolicy.actuators.resize.foreign_resizes import ForeignResizes
from contextpolicy.actuators.resize.pod_patch import Patch
from contextpolicy.actuators.resize.pod_state import Phase
from contextpolicy.actuators.resize.put_back import RestoreOrder, to_put_back, without_rises
from contextpolicy.actuators.resize.takeover import REWRITE_AFTER, can_rewrite
from contextpolicy.actuators.resize.targets import Target, steps, target_cpu
from contextpolicy.cluster.container_names import container_id
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping

    from contextpolicy.actuators.resize.contests import Contests
    from contextpolicy.actuators.resize.dispatcher import Dispatcher, Observer
    from contextpolicy.actuators.resize.originals import Originals
    from contextpolicy.actuators.resize.pod_index import PodIndex
    from contextpolicy.actuators.resize.tracked_pod import TrackedPod
    from contextpolicy.cluster.pods import Cpu


class Reconciler:
    """Level-triggered: `reconcile` may be called at any time and sends only what is missing."""

    def __init__(  # noqa: PLR0913 - all that a policy's resizes concern
        self,
        order: Order,
        pods: PodIndex,
        originals: Originals,
        dispatcher: Dispatcher,
        observer: Observer,
        *,
        contests: Contests,
    ) -> None:
        self.order = order
        """What the policy wants; see `follow`."""
        self._before: dict[tuple[str, str], Cpu] = {}
        """What each container had when the current plan came, by pod UID and name."""
        self._releasing = False
        self._handed_over: frozenset[str] = frozenset()
        """The nodes whose agents came or went, or began or ceased to write, with the newest order."""
        self.again = inf
        """Loop time in seconds at which to call `reconcile` again, if nothing happens before."""
        self._policy = order.policy
        self._namespace = order.policy.partition("/")[0]
        self._pods, self._originals, self._dispatcher, self._observer = pods, originals, dispatcher, observer
        self._foreign = ForeignResizes(order.policy, contests, observer)
        self._touched: set[str] = set()
        """UIDs of the pods that the policy resizes or still has to restore; it looks at no others."""
        self._restores = RestoreOrder(order.policy)
        self._wanted: dict[str, dict[str, Target]] = {}
        """The targets of the last pass, by pod UID and container name."""
        self._pressing: set[str] = set()
        """UIDs of the pods whose every change counts: they can't be lowered, or are restored."""

    def follow(self, order: Order) -> None:
        """Take what the policy wants from now on."""
        if order.shares != self.order.shares:
            self._before.clear()
        self._handed_over |= (self.order.agents ^ order.agents) | (self.order.attended ^ order.attended)
        self.order, self._releasing = order, False

    def release(self) -> None:
        """The policy is being deleted: put everything back, and send what was refused again at once."""
        self.follow(Order(self._policy, frozenset()))
        self._releasing = True
        for pod in self._pods.known(self._touched):
            pod.refusals.pop((self._policy, True), None)
        unproven = self._originals.unproven(self._policy)
        for pod in self._pods.known(unproven):
            error = ActuationError("Unproven", unproven[pod.uid], retriable=False)
            self._observer.on_problem(self._policy, pod.view.name, error)

    def forget(self, pod: TrackedPod) -> None:
        """The pod is gone."""
        for container in pod.view.containers:
            self._before.pop((pod.uid, container.name), None)

    def concerns(self, pod: TrackedPod) -> bool:
        """Whether a change of the pod may matter to the policy."""
        view = pod.view
        return view.namespace == self._namespace and (
            view.uid in self._touched
            or view.uid in self._originals.unproven(self._policy)
            or any(container_id(view, container.name) in self.order.claimed for container in view.containers)
        )

    def awaits(self, pod: TrackedPod) -> bool:
        """Whether there may be more to send because of the pod, whose standing is the same or whose patch has ended.

        Not when the API merely has what the plan wants: until it is in force it frees nothing for others.
        """
        uid, state = pod.uid, pod.state
        if self._releasing or uid in self._pressing or state.phase not in (Phase.IDLE, Phase.IN_FLIGHT):
            return True
        return state.ready and any(state.spec(name) != w.cpu for name, w in self._wanted.get(uid, {}).items())

    def reconcile(self, now: float) -> None:
        """Send what may be sent now."""
        self._take_over(now)
        targets = list(self._targets(now))
        self._wanted = defaultdict(dict)
        for target in targets:
            self._wanted[target.pod.uid][target.container.name] = target
            if target.pod.rewrites:
                target.pod.end_rewrite(target.container, target.cpu, now)
        kept = self._originals.of(self._policy)
        lost = {uid for uid, name in kept if name not in self._wanted.get(uid, {})}
        self._touched.update(self._wanted, lost)
        pods = self._pods.known(self._touched)
        for pod in pods:
            if pod.state.due <= now:
                self._wake(pod)
            if pod.owned.keys() - self._wanted.get(pod.uid, {}).keys():
                self._foreign.let_go(pod, self.order.claimed)
        due = [pod.state.due for pod in pods]
        for target in targets:
            due += [target.pod.nudge_state.until, target.pod.rewrites.get(target.container.name, inf)]
            due += self._foreign.look(target, now)
        forward = self._steps(targets, pods, now)
        back = {pod.uid: self._to_put_back(pod) for pod in pods if pod.uid in lost}
        bound = self._restores.bound(pods, back, now)
        due += bound.values()
        # Decreases first: workers take patches in this order, so the room for the increases is free sooner.
        for pod in sorted(pods, key=partial(_turn, forward)):
            due += self._send(pod, forward.get(pod.uid, {}), back.get(pod.uid, {}), bound, now)
        self._touched = {pod.uid for pod in pods if self._has_to_do_with(pod)}
        self._pressing = {target.pod.uid for target in targets if target.stuck} | {uid for uid in back if back[uid]}
        self.again = min([moment for moment in due if moment > now], default=inf)

    def is_released(self) -> bool:
        """Whether nothing is left to restore or in doubt; pods that have ended don't count."""
        kept = {uid for uid, _ in self._originals.of(self._policy)} | self._originals.unproven(self._policy).keys()
        return all(
            pod.view.ended or not (pod.uid in kept or pod.state.originator == self._policy)
            for pod in self._pods.known(self._touched | kept)
        )

    def _take_over(self, now: float) -> None:
        """Have the containers of agents that went written once more; an agent that came writes itself."""
        handed_over, self._handed_over = self._handed_over, frozenset()
        inherited = self._originals.inherited(self._policy)
        if not (handed_over or inherited):
            return
        settled: set[str] = set()
        for identity in self.order.shares:
            node = self.order.nodes.get(identity, "")
            pod, container = self._pods.find(identity)
            if pod is None or container is None or not (node in handed_over or pod.uid in inherited):
                continue
            settled.add(pod.uid)
            self._originals.attend(pod.uid)
            pod.rewrites.pop(container.name, None)
            if node not in self.order.agents and can_rewrite(container):
                pod.rewrites[container.name] = now + REWRITE_AFTER
        self._originals.settle(self._policy, settled)

    def _targets(self, now: float) -> Iterator[Target]:
        """The containers with a share. A plan ordered late may name containers that the policy has lost since."""
        for identity in self.order.shares:
            pod, container = self._pods.find(identity)
            if pod is not None and container is not None and identity in self.order.claimed and not pod.view.ended:
                original = self._originals.at(pod.uid, container.name)
                untouched = original is None and container.name not in pod.rewrites
                if untouched and self.order.leaves_alone(identity):
                    continue
                wanted = target_cpu(self.order, identity, pod, container, original)
                spec = pod.state.spec(container.name)
                before = self._before.setdefault((pod.uid, container.name), spec or container.spec)
                stuck = pod.is_stuck(self._policy, now)
                yield Target(identity, pod, container, wanted, spec, before, original, stuck)

    def _wake(self, pod: TrackedPod) -> None:
        """Let a pod continue after its pause."""
        pod.state.wake()
        if pod.state.phase is Phase.ASKING:
            self._dispatcher.ask(pod)

    def _steps(self, targets: Collection[Target], pods: Iterable[TrackedPod], now: float) -> dict[str, dict[str, Cpu]]:
        """The resources that may be set now, by pod UID and container name.

        Before the first resize, the originals of all containers with a share are stored: that costs one write for all,
        and none when a later plan resizes the next container.
        """
        found = steps(self.order, targets, self._leaving(pods), now)
        stored = {
            uid: {name: cpu for name, cpu in resources.items() if self._originals.is_stored(self._policy, uid, name)}
            for uid, resources in found.items()
        }
        if stored != found:
            for target in targets:
                self._note(target)
        return stored

    def _note(self, target: Target) -> None:
        """Note the container's original. For one that we own already, a foreign change of it is not the original."""
        view, name = target.pod.view, target.container.name
        ownership = target.pod.owned.get(name)
        before = ownership.cpu if ownership is not None else target.pod.state.spec(name)
        if before is not None:
            self._originals.note(self._policy, view.uid, view.name, name, before)
        if view.node in self.order.agents | self.order.attended:
            self._originals.attend(view.uid)

    def _leaving(self, pods: Iterable[TrackedPod]) -> Mapping[str, int]:
        """By node, the limits that pods being deleted have from the policy: they hold until their containers end."""
        leaving: dict[str, int] = defaultdict(int)
        for pod in pods:
            if pod.view.ended and pod.view.running:
                kept = self._originals.in_pod(pod.uid).items()
                own = [name for name, original in kept if original.policy == self._policy]
                leaving[pod.view.node] += sum(map(pod.state.highest, own))
        return leaving

    def _to_put_back(self, pod: TrackedPod) -> dict[str, Cpu]:
        """The originals of containers that the policy no longer claims; those restored already are just dropped."""
        uid, state = pod.uid, pod.state
        back = to_put_back(state, self._originals.in_pod(uid), self._policy, self.order.claimed)
        if back and state.ready and not pod.view.ended:
            # In a ready pod, a spec of None means that the container does not exist.
            for name in [name for name, cpu in back.items() if state.spec(name) in (cpu, None)]:
                del back[name]
                state.expect_back(name, self._policy)
                self._originals.drop(uid, name)
        return back

    def _send(
        self,
        pod: TrackedPod,
        forward: Mapping[str, Cpu],
        back: Mapping[str, Cpu],
        bound: Mapping[str, float],
        now: float,
    ) -> list[float]:
        """Send one pod what may be sent now; returns when there may be more to send, as far as time decides that."""
        due = []
        if not pod.view.ended:
            ready = without_rises(pod.state, back) if bound.get(pod.view.node, -inf) > now else back
            # At most one of the two is sent: the first leaves the pod busy, and its end brings us back here.
            for wanted, restore in ((forward, False), (ready, True)):
                if wanted:
                    due.append(self._request(pod, wanted, now, restore=restore))
                else:
                    pod.refusals.pop((self._policy, restore), None)
        if not (forward or back or pod.state.patch):
            self._dispatcher.recovered(self._policy, pod)
        return due

    def _request(self, pod: TrackedPod, wanted: Mapping[str, Cpu], now: float, *, restore: bool) -> float:
        """Send a patch for one pod unless it has to wait; returns until when, or infinity."""
        if not pod.state.ready:
            return inf  # the end of the patch under way triggers the next pass
        moment = max(pod.state.settles_at, pod.refused_until(self._policy, wanted, restore=restore))
        if moment > now:
            return moment
        self._dispatcher.send(pod, Patch(self._policy, wanted, restore))
        return inf

    def _has_to_do_with(self, pod: TrackedPod) -> bool:
        own, state = self._policy, pod.state
        return (
            state.originator == own
            or own in pod.troubled
            or own in state.putting_back.values()
            or own in [ownership.policy for ownership in pod.owned.values()]
            or own in [original.policy for original in self._originals.in_pod(pod.uid).values()]
        )


def _turn(steps_of: Mapping[str, Mapping[str, Cpu]], pod: TrackedPod) -> tuple[bool, int]:
    """Where a pod's step stands in line: what raises the sum of its limits last, and of its like the most first.

    With dozens of pods the workers take several resizes' time for the line, and the plan is about what gains the most.
    """
    step = steps_of.get(pod.uid, {}).items()
    change = sum([(cpu.limit or 0) - pod.state.least_known(name) for name, cpu in step])
    return change > 0, -abs(change)
