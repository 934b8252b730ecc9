"""One pod with everything that the resizer remembers about it besides the state of its patch. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING

from contextpolicy.actuators.resize.conflict import Ownership
from contextpolicy.actuators.resize.kubelet_nudge import NudgeState, nudge
from contextpolicy.actuators.resize.pauses import REFUSED
from contextpolicy.actuators.resize.takeover import aside, has_taken

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.actuators.resize.pod_patch import Patch
    from contextpolicy.actuators.resize.pod_state import PodState
    from contextpolicy.cluster.pods import ContainerView, Cpu, PodView


@dataclass(frozen=True, slots=True)
class Refusal:
    """Resources that the API refused `times` times in a row; they are not requested again before `until`."""

    resources: Mapping[str, Cpu]
    times: int
    until: float


@dataclass(slots=True)
class TrackedPod:
    """`owned` are the containers that policies decide about, `troubled` the policies with a reported problem.

    `refusals` are kept by policy and by whether the patch was a restore.
    """

    state: PodState
    uid: str = field(init=False)
    view: PodView = field(init=False)
    """The pod as the watch shows it."""
    owned: dict[str, Ownership] = field(default_factory=dict)
    nudge_state: NudgeState = field(default_factory=NudgeState)
    refusals: dict[tuple[str, bool], Refusal] = field(default_factory=dict)
    troubled: set[str] = field(default_factory=set)
    rewrites: dict[str, float] = field(default_factory=dict)
    """The containers that are to be written once more, and from when on."""

    def __post_init__(self) -> None:
        self.view = self.state.view
        self.uid = self.view.uid

    @property
    def standing(self) -> tuple[object, ...]:
        """All of what the watch shows that decides what may be sent, to this pod or to others; equal: nothing is news.

        While a patch is under way nothing else can be sent to the pod, and its end is news in any case.
        """
        state, view = self.state, self.view
        limits = [(c.name, state.ready and state.spec(c.name), state.highest(c.name)) for c in view.containers]
        place = view.node, view.ended, view.running, view.pending
        return limits, place, len(state.putting_back), len(self.refusals), self.nudge_state.until

    def observe(self, view: PodView, now: float) -> None:
        """Process the pod as the watch shows it. A new spec voids refusals: the same patch may be accepted now."""
        generation = self.view.generation
        if self.state.observe(view):
            self.view = view
            self.nudge_state.look(view, now)
            if view.generation != generation:
                self.refusals.clear()

    def find(self, view: PodView, now: float) -> bool:
        """Process the pod as read from the API server; returns whether the patch in doubt took effect."""
        self.observe(view, now)
        return self.state.find(view, now)

    def give(self, policy: str, name: str, cpu: Cpu) -> None:
        """The API server accepted the policy's resources for a container."""
        self.owned.setdefault(name, Ownership(policy, cpu)).give(policy, cpu)

    def refuse(self, patch: Patch, now: float) -> None:
        """The API server refused this patch; the same resources again have to wait longer."""
        before = self.refusals.get((patch.policy, patch.restore))
        times = before.times + 1 if before is not None and before.resources == patch.resources else 1
        self.refusals[patch.policy, patch.restore] = Refusal(patch.resources, times, now + REFUSED.after(times))

    def refused_until(self, policy: str, resources: Mapping[str, Cpu], *, restore: bool) -> float:
        """Until when not to request the same resources again; 0 when something else, or nothing, was refused."""
        refusal = self.refusals.get((policy, restore))
        return refusal.until if refusal is not None and refusal.resources == resources else 0.0

    def is_stuck(self, policy: str, now: float) -> bool:
        """Whether the API server or the kubelet currently refuses what the policy wants of the pod."""
        refusal = self.refusals.get((policy, False))
        refused = refusal is not None and now < refusal.until
        return refused or self.state.keeps_failing or bool(self.view.pending)

    def step(self, container: ContainerView, wanted: Cpu, spec: Cpu | None, now: float) -> Cpu:
        """The resources to request: those wanted, or others in between to make the kubelet write; `spec` is what is.

        A container that every resize restarts is not nudged: half a minute until the kubelet looks by itself is the
        lesser evil.
        """
        overlooked = now >= self.nudge_state.until and not container.restarts
        if now >= self.rewrites.get(container.name, inf):
            wanted = aside(self.view.qos, wanted)
        return nudge(container, wanted) if overlooked and spec == wanted else wanted

    def end_rewrite(self, container: ContainerView, wanted: Cpu, now: float) -> None:
        """Ask for what is wanted again once the kubelet has written the container."""
        due = now >= self.rewrites.get(container.name, inf)
        if due and container.spec == aside(self.view.qos, wanted) and has_taken(self.view, container):
            del self.rewrites[container.name]

    def rests_until(self, name: str) -> float:
        """Until when a foreign change of the container is left in place; -inf without one."""
        return self.owned[name].rests_until if name in self.owned else -inf
