"""A resize that the kubelet has overlooked, and the nudge that makes it look again. Pure.

A starting kubelet assumes that it has already handled the pods it finds. It looks at resources that it has not granted
yet only after 30 s, or as soon as those of any pod change (`initialRetryDelay` in Kubernetes 1.36's
kubelet/allocation/allocation_manager.go). When k3s restarts, its API is back before its kubelet, so resizes arrive in
between.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING

from contextpolicy.actuators.resize.pauses import OVERLOOKED
from contextpolicy.cluster.pods import Cpu

if TYPE_CHECKING:
    from contextpolicy.cluster.pods import ContainerView, PodView


@dataclass(slots=True)
class NudgeState:
    """Since when the kubelet has overlooked a pod's resources, and how often since the pod last had what it should.

    `until` is when to stop waiting for the kubelet and nudge it; infinity while nothing is overlooked.
    """

    since: float = inf
    times: int = 0
    until: float = inf

    def look(self, view: PodView, now: float) -> None:
        """Take the pod as the watch shows it."""
        if not view.overlooked:
            self.since = inf
            self.times = 0 if view.seen and all(container.granted for container in view.containers) else self.times
        elif self.since == inf:
            self.since, self.times = now, self.times + 1
        self.until = self.since + OVERLOOKED.after(self.times)

    def nudged(self) -> None:
        """A resize was sent: the kubelet looks again."""
        self.since = self.until = inf


def nudge(container: ContainerView, wanted: Cpu) -> Cpu:
    """The wanted resources, off by a thousandth of a core towards those in force: so the limits never sum to more.

    Requesting the same values again has no effect: the kubelet only sees changes.
    """
    actual = container.actual or wanted
    return Cpu(_towards(container.allocated, wanted.request), _towards(actual.limit, wanted.limit))


def _towards(now: int | None, wanted: int | None) -> int | None:
    if now is None or wanted is None or now == wanted:
        return wanted
    return wanted + (1 if now > wanted else -1)
