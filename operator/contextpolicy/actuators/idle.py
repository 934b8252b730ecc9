"""The actuator of a paused policy, which does nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from contextpolicy.actuators.order import Order
    from contextpolicy.actuators.resize.stored_originals import StoredOriginals
    from contextpolicy.cluster.pods import PodView


class Idle:
    """Keeps nothing and changes nothing."""

    def recall(self, policy: str, stored: StoredOriginals) -> None:
        """Nothing: it has changed nothing."""

    def apply(self, order: Order) -> None:
        """Nothing."""

    def release(self, policy: str, done: Callable[[], None]) -> None:  # noqa: ARG002 - the actuators' signature
        """Nothing was changed, so nothing is restored."""
        done()

    def abandon(self, policy: str) -> None:
        """Nothing is known of it."""

    def observe(self, pod: PodView) -> None:
        """Nothing: what pods have does not matter."""

    def forget(self, uid: str) -> None:
        """Nothing."""
