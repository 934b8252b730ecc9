"""Settings of the agent: read once from the environment; all mistakes are reported together."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from contextpolicy.errors import Finding
from contextpolicy.policy.environment import LOG_FORMATS, LOG_LEVELS, Environment

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


@dataclass(frozen=True, slots=True)
class AgentSettings:
    """The agent's configuration: `priority` is that of realtime threads, `grace` the grace period in seconds.

    `keys` is the directory of the certificate with the operator's public key, `credentials` that of our identity on the
    bus (None on an open bus); in `logs` the kubelet keeps a directory for each pod; the ledger is in `state`.
    """

    node: str
    keys: Path
    connect: tuple[str, ...]
    credentials: Path | None
    metrics_port: int
    log_format: str
    log_level: str
    cgroup_root: Path
    logs: Path
    state: Path
    priority: int
    grace: float


def read(variables: Mapping[str, str], *, priority: int, grace: float) -> AgentSettings:
    """Read the settings; SettingsError lists every invalid variable."""
    environment = Environment(variables)
    settings = _read(environment, priority, grace)
    environment.findings += _findings(settings, has_keys=bool(environment.text("PLAN_SIGNING")))
    environment.check()
    return settings


def read_for_supervisor(variables: Mapping[str, str], *, grace: float) -> AgentSettings:
    """Read what is needed to undo: neither keys nor a bus, nor what says whose a pod is."""
    environment = Environment(variables)
    settings = _read(environment, 1, grace)
    environment.findings += _missing_cgroups(settings.cgroup_root)
    environment.check()
    return settings


def _read(environment: Environment, priority: int, grace: float) -> AgentSettings:
    return AgentSettings(
        node=environment.text("NODE_NAME"),
        keys=environment.directory("PLAN_SIGNING") or Path(),
        connect=environment.endpoints("ZENOH_CONNECT"),
        credentials=environment.directory("ZENOH_CREDENTIALS"),
        metrics_port=environment.port("METRICS_PORT", 8081),
        log_format=environment.word("LOG_FORMAT", LOG_FORMATS, "text"),
        log_level=environment.word("LOG_LEVEL", LOG_LEVELS, "info"),
        cgroup_root=Path(environment.text("CGROUP_ROOT", "/sys/fs/cgroup")),
        logs=Path(environment.text("POD_LOGS", "/var/log/pods")),
        state=Path(environment.text("STATE_DIRECTORY", "/run/contextpolicy")),
        priority=priority,
        grace=grace,
    )


def _findings(settings: AgentSettings, *, has_keys: bool) -> Iterator[Finding]:
    node, root, logs = settings.node, settings.cgroup_root, settings.logs
    if not node or "/" in node:
        yield Finding("NODE_NAME", node or None, "the name of this node in the cluster")
    yield from _missing_cgroups(root)
    if not logs.is_dir():
        yield Finding("POD_LOGS", str(logs), "the directory where the kubelet keeps the pods' logs")
    if not has_keys:
        yield Finding("PLAN_SIGNING", None, "the directory of the certificate with the operator's public key")


def _missing_cgroups(root: Path) -> Iterator[Finding]:
    if not root.is_dir():
        yield Finding("CGROUP_ROOT", str(root), "the directory where the node's cgroups are mounted")
