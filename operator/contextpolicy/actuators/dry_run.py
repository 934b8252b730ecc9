"""Log what a plan would do, and do nothing."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from contextpolicy.policy.quantities import format_cpu

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from contextpolicy.actuators.order import Order
    from contextpolicy.cluster.pods import PodView

log = logging.getLogger(__name__)


class DryRun:
    """Logs every change of a share."""

    def __init__(self) -> None:
        self._last: dict[str, Mapping[str, int]] = {}

    def recall(self, policy: str, stored: object) -> None:
        """Nothing: an earlier dry run has changed nothing."""

    def apply(self, order: Order) -> None:
        """Log the shares that differ from the policy's last order."""
        before = self._last.pop(order.policy, {})
        for container, share in order.shares.items():
            if before.get(container) != share:
                log.info("dry run: %s would set the CPU of %s to %s", order.policy, container, format_cpu(share))
        if order.shares:
            self._last[order.policy] = dict(order.shares)

    def release(self, policy: str, done: Callable[[], None]) -> None:
        """There is nothing to restore."""
        self.abandon(policy)
        done()

    def abandon(self, policy: str) -> None:
        """Forget the policy."""
        self._last.pop(policy, None)

    def observe(self, pod: PodView) -> None:
        """Nothing: what pods have does not matter."""

    def forget(self, uid: str) -> None:
        """Nothing."""
