"""What the resizer knows of one pod: what was asked, what the API has, what the kubelet says is in force. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from contextpolicy.cluster.pods import Cpu, Original
from contextpolicy.planning.placement import QUANTUM

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.cluster.pods import PodView


@dataclass(slots=True)
class PodSlot:
    """One pod; at most one patch of it is under way, and a newer wish replaces one that has not been sent."""

    view: PodView
    busy: bool = False
    attempts: int = 0
    refused: Mapping[str, Cpu] | None = None
    generation: int = 0
    asked: dict[str, Cpu] = field(default_factory=dict)
    peaks: dict[str, int] = field(default_factory=dict)

    def observe(self, view: PodView) -> None:
        """Take what the watch says; a view from before our last accepted patch tells nothing about the spec."""
        if view.generation != self.view.generation:
            self.refused = None
        self.view = view
        if view.generation >= self.generation and not self.busy:
            self.asked = {}
        if self._settled():
            self.peaks = {}

    def sending(self, wanted: Mapping[str, Cpu]) -> None:
        """A patch is on its way: from now on its limits may be in force."""
        self.busy = True
        for name, cpu in wanted.items():
            self.peaks[name] = max(self.highest(name), cpu.limit or 0)
        self.asked |= wanted

    def accepted(self, generation: int, originals: Mapping[str, Original]) -> None:
        """The API took the patch, and the annotation that says what was there before."""
        self.busy, self.attempts, self.refused = False, 0, None
        self.view = replace(self.view, originals=originals)
        self.generation = max(self.generation, generation)
        self.observe(self.view)

    def failed(self, wanted: Mapping[str, Cpu], *, retriable: bool) -> None:
        """The API did not take the patch, or nobody knows: what was asked may be in force until the watch tells."""
        self.busy = False
        self.attempts += 1
        self.asked = {}
        if not retriable:
            self.refused = dict(wanted)

    def spec(self, name: str) -> Cpu | None:
        """The container's resources in the API, counting what it accepted and the watch has not shown yet."""
        container = self.view.container(name)
        return self.asked.get(name) or (container.spec if container else None)

    def highest(self, name: str) -> int:
        """The highest limit that may be in force now."""
        container, spec = self.view.container(name), self.spec(name)
        actual = container.actual.limit if container and container.actual else None
        return max(self.peaks.get(name, 0), (spec.limit if spec else None) or 0, actual or 0)

    def originals(self, policy: str, names: set[str]) -> dict[str, Original]:
        """What to remember before resizing these containers: what is saved already, else what they have now."""
        known = dict(self.view.originals)
        for name in names:
            container = self.view.container(name)
            if name not in known and container is not None:
                known[name] = Original(policy, container.spec)
        return known

    def _settled(self) -> bool:
        """Whether the kubelet has carried out everything that was asked."""
        view = self.view
        seen = view.observed_generation is None or view.observed_generation >= max(view.generation, self.generation)
        in_force = all(c.actual is None or _same(c.actual.limit, c.spec.limit) for c in view.containers)
        return seen and in_force and not self.busy and not self.asked and not view.pending


def _same(actual: int | None, spec: int | None) -> bool:
    """Equal up to the 10m steps in which the systemd cgroup driver rounds up (runc #4622)."""
    return -(-(actual or 0) // QUANTUM) == -(-(spec or 0) // QUANTUM)
