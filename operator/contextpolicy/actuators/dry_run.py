"""Log what a plan would do, and do nothing."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from contextpolicy.policy.quantities import format_cpu

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from contextpolicy.actuators.order import Order
    from contextpolicy.actuators.resize.stored_originals import StoredOriginals
    from contextpolicy.cluster.pods import PodView

log = logging.getLogger(__name__)


class DryRun:
    """Logs every change of what a container would have."""

    def __init__(self) -> None:
        self._last: dict[str, Mapping[str, tuple[int, int | None]]] = {}

    def recall(self, policy: str, stored: StoredOriginals) -> None:
        """Nothing: an earlier dry run has changed nothing."""

    def apply(self, order: Order) -> None:
        """Log what differs from the policy's last order."""
        before = self._last.get(order.policy, {})
        now = {container: (share, order.limits.get(container, share)) for container, share in order.shares.items()}
        for container, (share, limit) in now.items():
            if before.get(container) != (share, limit):
                capped = "its original limit" if limit is None else f"a limit of {format_cpu(limit)}"
                text = "dry run: %s would give %s a share of %s and %s"
                log.info(text, order.policy, container, format_cpu(share), capped)
        self._last[order.policy] = now

    def release(self, policy: str, done: Callable[[], None]) -> None:
        """Nothing was changed, so nothing is restored."""
        self.abandon(policy)
        done()

    def abandon(self, policy: str) -> None:
        """Forget the policy."""
        self._last.pop(policy, None)

    def observe(self, pod: PodView) -> None:
        """Nothing: what pods have does not matter."""

    def forget(self, uid: str) -> None:
        """Nothing."""
