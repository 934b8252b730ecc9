"""The operator's settings, read once from the environment; all mistakes are reported together."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from socket import gethostname
from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.errors import Finding, SettingsError
from contextpolicy.policy.tenants import Tenants, read_tenants

if TYPE_CHECKING:
    from collections.abc import Mapping

LOG_FORMATS = ("text", "json")
LOG_LEVELS = ("debug", "info", "warning", "error")
DEFAULT_CONNECT = "tcp/127.0.0.1:7447"
LONGEST_LEASE = 60


class OwnPod(NamedTuple):
    """The pod that this process runs in."""

    name: str
    uid: str


@dataclass(frozen=True, slots=True)
class Settings:
    """The operator's settings; empty `namespaces` means all.

    `credentials` and `signing` are directories with the files that `bus.credentials` and `bus.signatures` describe: our
    identity on the bus (None on an open bus), and the key that signs plans (None: plans are not signed).

    `lease` is the namespace and name of the Lease for which this operator's replicas run (None: it has none), held for
    `lease_seconds` at a time by the replica that calls itself `identity`, and deleted with `lease_pod`, which is in the
    same namespace (None: it stays).
    """

    connect: tuple[str, ...] = (DEFAULT_CONNECT,)
    credentials: Path | None = None
    signing: Path | None = None
    namespaces: tuple[str, ...] = ()
    tenants: Tenants = field(default_factory=Tenants)
    health_port: int = 8080
    metrics_port: int = 8081
    live_port: int = 8082
    lease: tuple[str, str] | None = None
    lease_seconds: int = 15
    lease_pod: OwnPod | None = None
    identity: str = field(default_factory=gethostname)
    log_format: str = "text"
    log_level: str = "info"


def read(environment: Mapping[str, str]) -> Settings:
    """Read the settings; SettingsError names every invalid variable."""
    findings: list[Finding] = []
    example = "contextpolicy-system/contextpolicy"
    lease = _pair(environment, "LEASE", f"a namespace and a name, such as {example}", findings)
    pod = _pair(environment, "LEASE_POD", "a pod's name and UID, such as contextpolicy-1/d9607e19", findings)
    settings = Settings(
        connect=_words(environment.get("ZENOH_CONNECT", "")) or (DEFAULT_CONNECT,),
        credentials=_directory(environment, "ZENOH_CREDENTIALS", findings),
        signing=_directory(environment, "PLAN_SIGNING", findings),
        namespaces=_words(environment.get("WATCH_NAMESPACES", "")),
        tenants=read_tenants(environment.get("TENANTS", "") or "{}", findings),
        health_port=_port(environment, "HEALTH_PORT", 8080, findings),
        metrics_port=_port(environment, "METRICS_PORT", 8081, findings),
        live_port=_port(environment, "LIVE_PORT", 8082, findings),
        lease=lease,
        lease_seconds=_seconds(environment, findings),
        lease_pod=OwnPod(*pod) if pod else None,
        identity=environment.get("IDENTITY", "") or gethostname(),
        log_format=_word(environment, "LOG_FORMAT", LOG_FORMATS, "text", findings),
        log_level=_word(environment, "LOG_LEVEL", LOG_LEVELS, "info", findings),
    )
    findings += [
        Finding("ZENOH_CONNECT", endpoint, "endpoints such as tcp/router:7447, comma separated")
        for endpoint in settings.connect
        if "/" not in endpoint
    ]
    if findings:
        raise SettingsError("environment", tuple(findings))
    return settings


def _words(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())


def _directory(environment: Mapping[str, str], name: str, findings: list[Finding]) -> Path | None:
    text = environment.get(name, "")
    if not text:
        return None
    if not Path(text).is_dir():
        findings.append(Finding(name, text, "a directory, such as a mounted Secret"))
    return Path(text)


def _port(environment: Mapping[str, str], name: str, default: int, findings: list[Finding]) -> int:
    text = environment.get(name, "") or str(default)
    if text.isdecimal() and 0 < int(text) < 65536:
        return int(text)
    findings.append(Finding(name, text, "a port from 1 to 65535"))
    return default


def _pair(environment: Mapping[str, str], name: str, allowed: str, findings: list[Finding]) -> tuple[str, str] | None:
    text = environment.get(name, "")
    first, _, second = text.partition("/")
    if text and not (first and second and "/" not in second):
        findings.append(Finding(name, text, allowed))
    return (first, second) if text else None


def _seconds(environment: Mapping[str, str], findings: list[Finding]) -> int:
    text = environment.get("LEASE_SECONDS", "") or "15"
    if text.isdecimal() and 0 < int(text) <= LONGEST_LEASE:
        return int(text)
    findings.append(Finding("LEASE_SECONDS", text, f"whole seconds from 1 to {LONGEST_LEASE}"))
    return 15


def _word(
    environment: Mapping[str, str], name: str, allowed: tuple[str, ...], default: str, findings: list[Finding]
) -> str:
    text = (environment.get(name, "") or default).lower()
    if text not in allowed:
        findings.append(Finding(name, text, "one of " + ", ".join(allowed)))
    return text
