"""Follows the resizes: stage times for the metrics, problems for status and events."""

from __future__ import annotations

import time
from collections import deque
from math import inf
from types import MappingProxyType
from typing import TYPE_CHECKING, Protocol

from contextpolicy.actuators.resize.conflict import YIELDED, Conflict
from contextpolicy.cluster.pods import Cpu
from contextpolicy.policy.quantities import format_cpu
from contextpolicy.telemetry import metrics, remedies
from contextpolicy.telemetry.reactions import Reactions

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping

    from contextpolicy.cluster.pods import PodView
    from contextpolicy.errors import ActuationError
    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.telemetry.reactions import Reaction

RECENT = 100
"""Reactions that are kept for the live view; the histograms have them all."""
FAILED = "ResizeFailed"
"""Reason of the event which says that the API server refused a resize, or did not answer."""
RECOVERED = "ResizeRecovered"
"""Reason of the event which says that a problem is over."""
CHANGED = (
    "another writer changed status.originals; the operator has restored it: restrict writes to contextpolicies/status"
)
CHANGED_PAUSE = 300.0
"""Seconds between two Events about that."""


class ResizeListener(Protocol):
    """Receives news of resizes."""

    def knows(self, policy: str) -> bool:
        """Whether the policy is still there; one that is released does not wait for answers about pods that end."""

    def on_problem(self, policy: str, reason: str, message: str) -> None:
        """There is a problem, or it is over: once each."""

    def on_stage(self, policy: str, stage: str, container: str, cores: float, at: float) -> None:
        """The API has accepted a limit (`accepted`), or the node has it in force (`inForce`); `at` is monotonic."""


class ResizeWatch:
    """Notified of every patch, on the loop's thread. Times are monotonic seconds."""

    def __init__(self, listener: ResizeListener) -> None:
        self._listener = listener
        self._reactions = Reactions()
        self._recent: dict[str, deque[float]] = {}
        self._failed: dict[str, dict[str, str]] = {}
        self._held: dict[str, dict[str, str]] = {}
        self._conflicts: dict[str, dict[str, str]] = {}
        self._changed: dict[str, float] = {}
        """When it was last reported that another writer changed a policy's originals."""

    def planned(
        self,
        policy: str,
        plan: Plan,
        ordered: float,
        left_alone: Collection[str] = (),
        requests: Mapping[str, int] = MappingProxyType({}),
    ) -> None:
        """A new plan was ordered, at this time; containers that are `left_alone` keep what they have."""
        self._reactions.plan(policy, plan, ordered, left_alone, requests)
        self._take_confirmed(policy)
        if plan.arrived is not None:
            metrics.SAMPLE_TO_PLAN.labels(*metrics.labels(policy)).observe(ordered - plan.arrived)

    def on_accepted(self, policy: str, container: str, cpu: Cpu, answered: float) -> None:
        """The API has accepted new resources; `answered` is when its answer came."""
        if not self._listener.knows(policy):
            return
        self._listener.on_stage(policy, "accepted", container, (cpu.limit or 0) / 1000, answered)
        metrics.RESIZES.labels(*metrics.labels(policy), "accepted").inc()
        reaction = self._reactions.reach(policy, container, "patch", cpu)
        if reaction is not None:
            reaction.accepted = answered
            metrics.PLAN_TO_PATCH.labels(*metrics.labels(policy)).observe(answered - reaction.planned)

    def on_in_force(self, policy: str, container: str, limit: int) -> None:
        """The kubelet reports the plan's limit, in millicores."""
        now = time.monotonic()
        self._listener.on_stage(policy, "inForce", container, limit / 1000, now)
        reaction = self._reactions.reach(policy, container, "status", Cpu(None, limit))
        if reaction is not None:
            self._on_reaction(policy, reaction, now)

    def on_confirmed(self, policy: str, node: str, sequence: int, failed: Collection[str]) -> None:
        """A node's agent has written what the plan says, but for the containers that `failed`."""
        self._reactions.confirm(policy, node, sequence, time.monotonic(), failed)
        self._take_confirmed(policy)

    def _take_confirmed(self, policy: str) -> None:
        for reaction, at in self._reactions.confirmed(policy):
            self._on_reaction(policy, reaction, at)

    def _on_reaction(self, policy: str, reaction: Reaction, now: float) -> None:
        labels = metrics.labels(policy)
        self._recent.setdefault(policy, deque(maxlen=RECENT)).append(now - reaction.arrived)
        metrics.REACTION.labels(*labels).observe(now - reaction.arrived)
        if reaction.accepted is not None:
            metrics.PATCH_TO_IN_FORCE.labels(*labels).observe(now - reaction.accepted)

    def on_problem(self, policy: str, pod: str, error: ActuationError | None) -> None:
        """A patch failed, or (None) succeeded again after a failure."""
        if not self._listener.knows(policy):
            return
        failed = self._failed.setdefault(policy, {})
        if error is None:
            if failed.pop(pod, None):
                self._listener.on_problem(policy, RECOVERED, f"{pod}: updates succeed again")
            return
        metrics.RESIZES.labels(*metrics.labels(policy), error.reason).inc()
        message = _advised(f"{pod}: {error.reason}: {error}", remedies.for_refusal(error))
        if failed.get(pod) != message:
            failed[pod] = message
            self._listener.on_problem(policy, FAILED, message)

    def on_conflict(self, policy: str, container: str, conflict: Conflict | None) -> None:
        """Another writer resized a container, or (None) has not done so for a while."""
        if not self._listener.knows(policy):
            return
        conflicts = self._conflicts.setdefault(policy, {})
        if conflict is None:
            if conflicts.pop(container, None):
                self._listener.on_problem(policy, RECOVERED, f"{container}: no other writer has resized it for a while")
            return
        self._reactions.drop(policy, container)
        metrics.CONFLICTS.labels(*metrics.labels(policy)).inc()
        by, changes = conflict.by or "another writer", ", ".join(_changes(conflict))
        message = f"{container}: {by} changed its {changes}; {_answer(conflict)}"
        message = _advised(message, remedies.for_writer(conflict.by))
        if conflicts.get(container) != message:
            conflicts[container] = message
            self._listener.on_problem(policy, "ResizedByOther", message)

    def on_changed_by_other(self, policy: str) -> None:
        """Another writer changed the originals in the policy's status; reported once in a while, however often."""
        now = time.monotonic()
        if self._listener.knows(policy) and now - self._changed.get(policy, -inf) >= CHANGED_PAUSE:
            self._changed[policy] = now
            self._listener.on_problem(policy, "OriginalsChanged", CHANGED)

    def observe(self, pod: PodView, policies: Collection[str]) -> None:
        """Note whether the kubelet holds back a resize of the pod; `policies` are those that have resized it."""
        identity = f"{pod.namespace}/{pod.name}"
        asking = set(policies) if pod.pending else set()
        for policy in asking - self._held.keys():
            self._held[policy] = {}
        for policy, held in self._held.items():
            message = _advised(f"{pod.name}: {pod.pending}", remedies.for_pending(pod.pending))
            if policy in asking and held.get(identity) != message:
                held[identity] = message
                self._listener.on_problem(policy, "ResizePending", message)
            elif policy not in asking and identity in held:
                del held[identity]
                self._listener.on_problem(policy, RECOVERED, f"{pod.name}: the kubelet no longer holds back a resize")

    def lose(self, pod: PodView) -> None:
        """The pod is gone, and with it its problems and what it has yet to react to."""
        identity = f"{pod.namespace}/{pod.name}"
        self._reactions.lose(identity)
        for held in self._held.values():
            held.pop(identity, None)
        for conflicts in self._conflicts.values():
            for container in [container for container in conflicts if container.startswith(f"{identity}/")]:
                del conflicts[container]
        for policy, failed in self._failed.items():
            if policy.partition("/")[0] == pod.namespace:
                failed.pop(pod.name, None)

    def problems(self, policy: str) -> dict[str, str]:
        """What can't be applied now, or does not stay applied: messages by pod or container."""
        every = (self._failed, self._held, self._conflicts)
        return {subject: message for known in every for subject, message in known.get(policy, {}).items()}

    def recent(self, policy: str) -> list[float]:
        """The latest reactions to samples, from arrival until what they caused was in force; seconds, oldest first."""
        return list(self._recent.get(policy, ()))

    def forget(self, policy: str) -> None:
        """The policy is gone."""
        self._reactions.forget(policy)
        self._recent.pop(policy, None)
        self._changed.pop(policy, None)
        for known in (self._failed, self._held, self._conflicts):
            known.pop(policy, None)


def _advised(message: str, remedy: str) -> str:
    return f"{message}; {remedy}" if remedy else message


def _answer(conflict: Conflict) -> str:
    if conflict.yielded:
        return (
            "as this keeps happening, the operator leaves the change in place and retries the plan's value "
            f"every {YIELDED / 60:g} min"
        )
    return "the operator writes the plan's value again"


def _changes(conflict: Conflict) -> Iterator[str]:
    for kind, had, got in (
        ("limit", conflict.had.limit, conflict.got.limit),
        ("request", conflict.had.request, conflict.got.request),
    ):
        if had != got:
            yield f"CPU {kind} from {_cpu(had)} to {_cpu(got)}"


def _cpu(amount: int | None) -> str:
    return "none" if amount is None else format_cpu(amount)
