"""What is known of one pod between a patch and its effect: one explicit state, and one table of its transitions. Pure.

Rule: everything that changes this state lives in this file, and phases change only through TRANSITIONS. The queries
(properties, `spec`, `highest`, ...) change nothing.
"""

from __future__ import annotations

from enum import StrEnum, auto
from math import inf
from typing import TYPE_CHECKING

from contextpolicy.actuators.resize.pauses import FAILED

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.actuators.resize.pod_patch import Patch
    from contextpolicy.cluster.pods import Cpu, PodView
    from contextpolicy.errors import ActuationError

SETTLING = 0.3
"""Seconds for which a newer target waits for the kubelet to finish the last resize. The kubelet handles the resizes of
a pod one after the other, so when contexts change quickly each outdated one would only delay the newest."""


class Phase(StrEnum):
    """Where a pod's patch stands."""

    IDLE = auto()
    """No patch is under way."""
    IN_FLIGHT = auto()
    """A patch was sent and is not answered yet."""
    RETRYING = auto()
    """The server can't do it now, so nothing took effect; the pod waits until `due`."""
    UNSURE = auto()
    """The answer was lost, so the patch may have taken effect; the pod waits until `due`."""
    ASKING = auto()
    """The pod is being read from the API server to learn what it has."""
    GONE = auto()
    """The API server has no such pod."""


class Event(StrEnum):
    """What can happen to a pod's patch."""

    SENT = auto()
    ACCEPTED = auto()
    REFUSED = auto()
    POSTPONED = auto()
    LOST = auto()
    DUE = auto()
    FOUND = auto()
    MISSING = auto()


TRANSITIONS: Mapping[Phase, Mapping[Event, Phase]] = {
    Phase.IDLE: {Event.SENT: Phase.IN_FLIGHT},
    Phase.IN_FLIGHT: {
        Event.ACCEPTED: Phase.IDLE,
        Event.REFUSED: Phase.IDLE,
        Event.POSTPONED: Phase.RETRYING,
        Event.LOST: Phase.UNSURE,
        # A 404 may mean the pod or its subresource `resize`; only reading the pod shows which.
        Event.MISSING: Phase.ASKING,
    },
    Phase.RETRYING: {Event.DUE: Phase.IDLE},
    Phase.UNSURE: {Event.DUE: Phase.ASKING},
    Phase.ASKING: {
        Event.FOUND: Phase.IDLE,
        Event.MISSING: Phase.GONE,
        Event.REFUSED: Phase.UNSURE,
        Event.POSTPONED: Phase.UNSURE,
        Event.LOST: Phase.UNSURE,
    },
    Phase.GONE: {},
}


class PodState:
    """One pod; at most one patch is under way, newer targets wait until it ends.

    Three layers of knowledge: `view` is what the watch shows, `_accepted` what the API server has confirmed since, and
    `_peaks` are limits that may still be in force although neither says so.
    """

    def __init__(self, view: PodView) -> None:
        self.view = view
        self.phase = Phase.IDLE
        self.patch: Patch | None = None
        """The patch whose effect is not known yet."""
        self.due = inf
        """Loop time in seconds at which a waiting pod continues; infinity when it does not wait."""
        self.putting_back: dict[str, str] = {}
        """Containers that were put back, with the policy that had resized them, until the kubelet has done it."""
        self._version = 0
        self._accepted: dict[str, Cpu] = {}
        self._peaks: dict[str, int] = {}
        self._failures = 0
        self._accepted_at = -inf

    # what happens

    def observe(self, view: PodView) -> bool:
        """Take the pod as the watch shows it; False when that is older than our last write."""
        # The watch lags behind the answers to our patches: an old event must not bring the old spec back.
        if view.version < self._version:
            return False
        if view.generation != self.view.generation:
            self._keep_peaks(view)
        self.view = view
        self._settle()
        return True

    def send(self, patch: Patch) -> None:
        """A patch is sent: until its outcome is known, both the old and the new limits may be in force."""
        self._move(Event.SENT)
        self._peaks |= {name: self.highest(name) for name in patch.resources}
        self.patch = patch

    def accept(self, version: int, now: float) -> None:
        """The API server accepted the patch; `version` is the changed pod's resourceVersion."""
        self._move(Event.ACCEPTED)
        self._version = max(self._version, version)
        self._take_effect(now)

    def refuse(self) -> None:
        """The API server refused the patch: nothing has changed."""
        self._move(Event.REFUSED)
        self._end()

    def postpone(self, error: ActuationError, now: float) -> float:
        """The API server can't take the patch now; returns the pause in seconds."""
        self._move(Event.POSTPONED)
        self._end()
        return self._rest(error, now)

    def lose(self, error: ActuationError, now: float) -> float:
        """No usable answer came, to a patch or to a read; returns the pause in seconds until the pod is read."""
        self._move(Event.LOST)
        return self._rest(error, now)

    def miss(self) -> None:
        """The API server answered NotFound."""
        self._move(Event.MISSING)

    def wake(self) -> None:
        """The pause is over: a patch may be sent again, or the pod is to be read."""
        self._move(Event.DUE)
        self.due = inf

    def find(self, view: PodView, now: float) -> bool:
        """The pod was read from the API server; returns whether the patch took effect."""
        patch = self.patch
        self.observe(view)
        self._move(Event.FOUND)
        if patch is not None and all(self._has(name, cpu) for name, cpu in patch.resources.items()):
            self._take_effect(now)
            return True
        self._end()
        return False

    def expect_back(self, name: str, policy: str) -> None:
        """The API already has the container's original; until the kubelet applies it, the container may have more."""
        if name in self.view.by_name and self.highest(name) > self.least_known(name):
            self.putting_back[name] = policy

    # what is known

    @property
    def originator(self) -> str | None:
        """The policy whose patch is under way or in doubt."""
        return self.patch.policy if self.patch else None

    @property
    def keeps_failing(self) -> bool:
        """Whether more than one patch in a row has failed."""
        return self._failures > 1

    @property
    def ready(self) -> bool:
        """Whether a patch may be sent."""
        return self.phase is Phase.IDLE

    @property
    def settles_at(self) -> float:
        """Until when to wait for the kubelet to finish our last resize; one that it has deferred is not waited for."""
        return self._accepted_at + SETTLING if self._peaks and not self.view.pending else -inf

    def spec(self, name: str) -> Cpu | None:
        """The container's resources in the API, including writes not on the watch yet; None when unknown."""
        if self.phase in (Phase.UNSURE, Phase.ASKING):
            return None
        container = self.view.by_name.get(name)
        return self._accepted.get(name) or (container.spec if container else None)

    def least_known(self, name: str) -> int:
        """The last known limit in the API, in thousandths of a core; 0 without one."""
        container = self.view.by_name.get(name)
        known = self._accepted.get(name) or (container.spec if container else None)
        return (known.limit if known else None) or 0

    def highest(self, name: str) -> int:
        """The highest limit that may be in force now, in thousandths of a core."""
        container = self.view.by_name.get(name)
        seen = (container.spec, container.actual) if container else ()
        known = (self._accepted.get(name), self.patch.resources.get(name) if self.patch else None, *seen)
        return max([self._peaks.get(name, 0), *[cpu.limit or 0 for cpu in known if cpu]])

    # how it changes

    def _move(self, event: Event) -> None:
        self.phase = TRANSITIONS[self.phase][event]

    def _rest(self, error: ActuationError, now: float) -> float:
        self._failures += 1
        pause = max(FAILED.after(self._failures), error.retry_after)
        self.due = now + pause
        return pause

    def _take_effect(self, now: float) -> None:
        if self.patch is not None:
            self._accepted |= self.patch.resources
            # Accepted is not in force: until the kubelet has resized the container, its old limit counts as well.
            self._peaks |= {name: self.highest(name) for name in self.patch.resources}
            if self.patch.restore:
                self.putting_back |= dict.fromkeys(self.patch.resources, self.patch.policy)
        self._failures, self._accepted_at = 0, now
        self._end()

    def _end(self) -> None:
        self.patch = None
        self._settle()

    def _has(self, name: str, cpu: Cpu) -> bool:
        container = self.view.by_name.get(name)
        return container is not None and container.spec == cpu

    def _keep_peaks(self, view: PodView) -> None:
        """A foreign resize replaced a spec that the kubelet may have applied unreported: either may be in force."""
        for container in view.containers:
            if container.spec != self.spec(container.name):
                self._peaks[container.name] = max(self.highest(container.name), container.spec.limit or 0)

    def _settle(self) -> None:
        """Forget what is over: confirmed writes once the watch shows them, peaks once the kubelet is done.

        While a patch is under way or in doubt, nothing is.
        """
        if self.patch is not None or self.view.version < self._version:
            return
        self._accepted = {}
        if self.view.seen and not self.view.pending and all(container.in_force for container in self.view.containers):
            self._peaks, self.putting_back = {}, {}
