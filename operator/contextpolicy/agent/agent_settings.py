"""Settings of the agent: read once from the environment; all mistakes are reported together."""

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
    """The agent's configuration: `priority` is that of realtime threads, `grace` the grace period in seconds.

    `keys` is the directory of the certificate with the operator's public key; in `logs` the kubelet keeps a directory
    for each pod; the ledger is in `state`.
    """

    node: str
    common: settings.Settings
    keys: Path
    cgroup_root: Path = Path("/sys/fs/cgroup")
    logs: Path = Path("/var/log/pods")
    state: Path = Path("/run/contextpolicy")
    priority: int = 10
    grace: float = 10.0


def read(environment: Mapping[str, str], *, priority: int, grace: float) -> AgentSettings:
    """Read the settings; SettingsError lists every invalid variable."""
    common = settings.read(environment)
    node = environment.get("NODE_NAME", "")
    root = Path(environment.get("CGROUP_ROOT", "") or "/sys/fs/cgroup")
    logs = Path(environment.get("POD_LOGS", "") or "/var/log/pods")
    findings = []
    if not node or "/" in node:
        findings.append(Finding("NODE_NAME", node, "the name of this node in the cluster"))
    if not root.is_dir():
        findings.append(Finding("CGROUP_ROOT", str(root), "the directory where the node's cgroups are mounted"))
    if not logs.is_dir():
        findings.append(Finding("POD_LOGS", str(logs), "the directory where the kubelet keeps the pods' logs"))
    if common.signing is None:
        findings.append(Finding("PLAN_SIGNING", "", "the directory of the certificate with the operator's public key"))
    if findings or common.signing is None:
        raise SettingsError("environment", tuple(findings))
    state = Path(environment.get("STATE_DIRECTORY", "") or "/run/contextpolicy")
    return AgentSettings(node, common, common.signing, root, logs, state, priority, grace)
