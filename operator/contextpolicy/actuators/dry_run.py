"""Log what a plan would do, and do nothing."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from contextpolicy.policy.quantities import format_cpu

if TYPE_CHECKING:
    from contextpolicy.actuators.order import Order

log = logging.getLogger(__name__)


class DryRun:
    """Logs every change of a share."""

    def __init__(self) -> None:
        self._last: dict[str, dict[str, int]] = {}

    def apply(self, order: Order) -> None:
        """Log the shares that differ from the policy's last order."""
        before = self._last.get(order.policy, {})
        for container, share in order.shares.items():
            if before.get(container) != share:
                log.info("dry run: %s would set the CPU of %s to %s", order.policy, container, format_cpu(share))
        self._last[order.policy] = dict(order.shares)
