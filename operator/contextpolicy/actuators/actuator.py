"""The contract of everything that makes plans real, and all actuators of one operator behind it."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Protocol

from contextpolicy.actuators.order import Order

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from contextpolicy.actuators.resize.stored_originals import StoredOriginals
    from contextpolicy.cluster.pods import PodView
    from contextpolicy.policy.spec import Mode


class Actuator(Protocol):
    """Level-triggered: each order states everything that its policy wants, and may be repeated.

    Everything is called on the loop's thread, and must not block.
    """

    def recall(self, policy: str, stored: StoredOriginals) -> None:
        """A policy appeared; `stored` is its `status.originals`, what its containers had before an earlier operator."""

    def apply(self, order: Order) -> None:
        """Make this the policy's desired state; what it claims no longer goes back to what it had before."""

    def release(self, policy: str, done: Callable[[], None]) -> None:
        """The policy is being deleted: put everything back, then call `done`. Called again, it retries at once."""

    def abandon(self, policy: str) -> None:
        """Another operator acts on the policy's pods: forget it, and change nothing."""

    def observe(self, pod: PodView) -> None:
        """A pod is new or has changed."""

    def forget(self, uid: str) -> None:
        """A pod is gone."""


class Actuators:
    """All actuators of an operator, one for each mode; what concerns all of them goes to each."""

    def __init__(self, by_mode: Mapping[Mode, Actuator]) -> None:
        self._by_mode = by_mode

    def of(self, mode: Mode) -> Actuator:
        """The actuator of a mode."""
        return self._by_mode[mode]

    def put_back_others(self, policy: str, mode: Mode) -> None:
        """The policy is in this mode now: the actuators of the others put back what they changed for it."""
        for other, actuator in self._by_mode.items():
            if other is not mode:
                actuator.apply(Order(policy, frozenset()))

    def recall(self, policy: str, stored: StoredOriginals) -> None:
        """See `Actuator.recall`."""
        for actuator in self._by_mode.values():
            actuator.recall(policy, stored)

    def release(self, policy: str, done: Callable[[], None]) -> None:
        """See `Actuator.release`; one after the other."""
        for actuator in self._by_mode.values():
            done = partial(actuator.release, policy, done)
        done()

    def abandon(self, policy: str) -> None:
        """See `Actuator.abandon`."""
        for actuator in self._by_mode.values():
            actuator.abandon(policy)

    def observe(self, pod: PodView) -> None:
        """See `Actuator.observe`."""
        for actuator in self._by_mode.values():
            actuator.observe(pod)

    def forget(self, uid: str) -> None:
        """See `Actuator.forget`."""
        for actuator in self._by_mode.values():
            actuator.forget(uid)
