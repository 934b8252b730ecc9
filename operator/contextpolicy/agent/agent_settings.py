"""Settings of the agent: read once from the environment, told wrong all at once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from contextpolicy import settings
from contextpolicy.errors import Finding, SettingsError

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True, slots=True)
class AgentSettings:
    """What an agent is told from outside: `priority` is that of realtime threads, `grace` is in seconds."""

    node: str
    common: settings.Settings
    cgroup_root: Path = Path("/sys/fs/cgroup")
    state: Path = Path("/run/contextpolicy")
    priority: int = 10
    grace: float = 10.0


def read(environment: Mapping[str, str], *, priority: int, grace: float) -> AgentSettings:
    """Read the settings; SettingsError names every variable that makes no sense."""
    common = settings.read(environment)
    node = environment.get("NODE_NAME", "")
    root = Path(environment.get("CGROUP_ROOT", "") or "/sys/fs/cgroup")
    findings = []
    if not node or "/" in node:
        findings.append(Finding("NODE_NAME", node, "the name of this node in the cluster"))
    if not root.is_dir():
        findings.append(Finding("CGROUP_ROOT", str(root), "the directory where the node's cgroups are mounted"))
    if findings:
        raise SettingsError("environment", tuple(findings))
    state = Path(environment.get("STATE_DIRECTORY", "") or "/run/contextpolicy")
    return AgentSettings(node, common, root, state, priority, grace)
