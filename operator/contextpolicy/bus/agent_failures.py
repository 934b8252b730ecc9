"""The containers that agents could not set, as their confirmations name them."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping

    from reactivex.abc import SchedulerBase

    from contextpolicy.cluster.agent_reports import Confirmation

log = logging.getLogger(__name__)

REST = 0.2
"""Seconds between two reports of changes: each makes all policies claim again."""
MOST_LINES = 10
"""Changes that are logged of those reported at once."""
MOST_REASONS = 3
"""Reasons named in a line of the log."""


class FailureListener(Protocol):
    """Receives failures; called on the loop's thread."""

    def on_agents(self) -> None:
        """Other containers than before could not be set."""


class AgentFailures:
    """Only the latest failures count: an agent tries again with each plan. Called on the loop's thread."""

    def __init__(self, scheduler: SchedulerBase, listener: FailureListener) -> None:
        self._scheduler, self._listener = scheduler, listener
        self._failed: dict[tuple[str, str], Mapping[str, str]] = {}
        self._changed: set[tuple[str, str]] = set()
        """The nodes and policies whose change is yet to be reported."""
        self._resting = False

    def of(self, policy: str) -> dict[str, Mapping[str, str]]:
        """By node, the containers (ID) to which its agent could not give what the policy's last plan says, and why."""
        return {node: failed for (node, other), failed in self._failed.items() if other == policy}

    def take(self, node: str, said: Confirmation) -> None:
        """A plan was carried out, but for what failed."""
        before = self._failed.pop((node, said.policy), {})
        if said.failed:
            self._failed[node, said.policy] = said.failed
        if said.failed.keys() != before.keys():
            self._changed.add((node, said.policy))
            if not self._resting:
                self._report()

    def forget(self, policy: str) -> None:
        """The policy's source of plans is gone."""
        self._failed = {key: failed for key, failed in self._failed.items() if key[1] != policy}

    def forget_node(self, node: str) -> None:
        """The node has no agent any more."""
        self._failed = {key: failed for key, failed in self._failed.items() if key[0] != node}

    def _report(self, *_: object) -> None:
        """Report what has changed, then pause."""
        changed, self._changed = sorted(self._changed), set()
        self._resting = bool(changed)
        if changed:
            self._log(changed)
            self._scheduler.schedule_relative(REST, self._report)
            self._listener.on_agents()

    def _log(self, changed: list[tuple[str, str]]) -> None:
        for node, policy in changed[:MOST_LINES]:
            reasons = sorted(set(self._failed.get((node, policy), {}).values()))
            failures = f"can't set containers: {', '.join(reasons[:MOST_REASONS])}"
            state = failures if reasons else "sets all containers again"
            log.warning("node %s, policy %s: the agent %s", node, policy, state)
        if len(changed) > MOST_LINES:
            log.warning("and %d more nodes and policies", len(changed) - MOST_LINES)
