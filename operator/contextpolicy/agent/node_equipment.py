"""What this node can do: its cgroups, once the kubelet has made them, and what it lacks."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from contextpolicy.agent import capabilities
from contextpolicy.agent.cgroup_paths import find_cgroups
from contextpolicy.agent.cgroup_writers import CgroupWriters

if TYPE_CHECKING:
    from contextpolicy.agent.agent_settings import AgentSettings
    from contextpolicy.agent.ledger import Ledger
    from contextpolicy.agent.open_files import FileWatch


class NodeEquipment:
    """Found with the first order that finds the pods' cgroups, as the kubelet may start after us."""

    def __init__(self, settings: AgentSettings, ledger: Ledger, watch: FileWatch) -> None:
        self.writers: CgroupWriters | None = None
        """What writes the pods' cgroups; None until they are found."""
        self.missing: dict[str, list[str]] = {}
        """What the node lacks, by scheduler."""
        self._settings, self._ledger, self._watch = settings, ledger, watch
        self._unlimited = ""
        self._most_processors = 1

    def find(self) -> CgroupWriters | None:
        """Find the pods' cgroups unless that is done."""
        if self.writers is None:
            layout = find_cgroups(self._settings.cgroup_root)
            facts = capabilities.probe(layout)
            self.missing, self._unlimited = capabilities.missing(facts), capabilities.unlimited(facts)
            if layout is not None:
                priority = self._settings.priority
                self.writers = CgroupWriters(layout, self._ledger, self._watch, priority, self.processors)
        return self.writers

    def processors(self) -> int:
        """Those that are switched on, or more if there were: what is switched off may come back."""
        self._most_processors = max(self._most_processors, os.cpu_count() or 1)
        return self._most_processors

    def report(self) -> dict[str, Any]:
        """What the node can do, and what it lacks for the rest, as a JSON object."""
        layout = self.writers.layout if self.writers else None
        return {
            "node": self._settings.node,
            "cgroup": layout.version if layout else None,
            "driver": layout.driver if layout else None,
            "processors": self.processors(),
            "quotaPeriod": capabilities.quota_period(layout),
            "missing": self.missing,
            "unlimited": self._unlimited,
        }
