"""One policy's containers that other clients resize too: when that is reported, and when it is over."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.actuators.resize import guard
from contextpolicy.cluster.container_names import container_id

if TYPE_CHECKING:
    from collections.abc import Collection

    from contextpolicy.actuators.resize.contests import Contests
    from contextpolicy.actuators.resize.dispatcher import Observer
    from contextpolicy.actuators.resize.targets import Target
    from contextpolicy.actuators.resize.tracked_pod import TrackedPod


class ForeignResizes:
    """Watches for writes that are not ours (see `guard`), and notes what is left in place for others."""

    def __init__(self, policy: str, contests: Contests, observer: Observer) -> None:
        self._policy, self._contests, self._observer = policy, contests, observer

    def look(self, target: Target, now: float) -> tuple[float, ...]:
        """Report when others resize the container, and when that is over; returns the loop times to look again."""
        pod, name = target.pod, target.container.name
        conflict = guard.look(self._policy, target, now)
        if conflict is not None:
            self._observer.on_conflict(self._policy, target.id, conflict)
        ownership = pod.owned.get(name)
        if ownership is None or not ownership.reported:
            return ()
        self._contests.note(pod.view, name, ownership.left)
        if now >= ownership.forgotten_at:
            ownership.reported = False
            self._observer.on_conflict(self._policy, target.id, None)
            return ()
        return ownership.rests_until, ownership.forgotten_at

    def let_go(self, pod: TrackedPod, claimed: Collection[str]) -> None:
        """Give up ownership of the pod's containers that the policy does not claim any more."""
        for name, ownership in list(pod.owned.items()):
            identity = container_id(pod.view, name)
            if ownership.policy == self._policy and (pod.view.ended or identity not in claimed):
                del pod.owned[name]
                self._contests.note(pod.view, name, None)
                pod.rewrites.pop(name, None)
                if ownership.reported:
                    self._observer.on_conflict(self._policy, identity, None)
