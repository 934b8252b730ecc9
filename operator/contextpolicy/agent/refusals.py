"""Orders and writes that the agent refused or failed: counted by reason, each reason logged once."""

from __future__ import annotations

import logging
from collections import Counter

from contextpolicy.agent.agent_metrics import REFUSALS

log = logging.getLogger(__name__)


class Refusals:
    """Counts by reason; a flood of forged messages must not become a flood of log lines."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()

    def note(self, reason: str, message: str) -> None:
        """Count a refusal, and log the first for each reason."""
        self.counts[reason] += 1
        REFUSALS.labels(reason).inc()
        if self.counts[reason] == 1:
            log.warning("%s: %s (further ones with this reason are only counted)", reason, message)
