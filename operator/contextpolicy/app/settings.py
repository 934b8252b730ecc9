"""The operator's settings, read once from the environment; all mistakes are reported together."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations
from socket import gethostname
from typing import TYPE_CHECKING

from contextpolicy.actuators.following import SETTLED
from contextpolicy.cluster.lease import LONGEST, OwnPod
from contextpolicy.errors import Finding
from contextpolicy.policy.environment import DEFAULT_CONNECT, LOG_FORMATS, LOG_LEVELS, Environment
from contextpolicy.policy.tenants import Tenants, read_tenants

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

MOST_SETTLED = 3600
"""Seconds: what lasts longer than an hour should be in the API, for when the agent is gone."""


@dataclass(frozen=True, slots=True)
class Settings:
    """The operator's settings; empty `namespaces` means all.

    `credentials` and `signing` are directories with the files that `bus.credentials` and `bus.signatures` describe: our
    identity on the bus (None on an open bus), and the key that signs plans (None: plans are not signed).

    `lease` is the namespace and name of the Lease for which this operator's replicas run (None: it has none), held for
    `lease_seconds` at a time by the replica that calls itself `identity`, and deleted with `lease_pod`, which is in the
    same namespace (None: it stays).

    `agents_everywhere` says that every node with tasks is to have a node agent, so that one without is reported.

    `settle_seconds` is for how long a plan has to stay the same before the API follows an agent.

    `originals_key` is the namespace and name of the Secret with the key that signs originals (None: nothing does).
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
    originals_key: tuple[str, str] | None = None
    agents_everywhere: bool = False
    settle_seconds: float = SETTLED
    identity: str = field(default_factory=gethostname)
    log_format: str = "text"
    log_level: str = "info"


def read(variables: Mapping[str, str]) -> Settings:
    """Read the settings; SettingsError names every invalid variable."""
    environment = Environment(variables)
    pod = environment.pair("LEASE_POD", "a pod's name and UID, such as contextpolicy-1/d9607e19")
    settings = Settings(
        connect=environment.endpoints("ZENOH_CONNECT"),
        credentials=environment.directory("ZENOH_CREDENTIALS"),
        signing=environment.directory("PLAN_SIGNING"),
        namespaces=environment.words("WATCH_NAMESPACES"),
        tenants=read_tenants(environment.text("TENANTS", "{}"), environment.findings),
        health_port=environment.port("HEALTH_PORT", 8080),
        metrics_port=environment.port("METRICS_PORT", 8081),
        live_port=environment.port("LIVE_PORT", 8082),
        lease=environment.pair("LEASE", "a namespace and a name, such as contextpolicy-system/contextpolicy"),
        lease_seconds=environment.whole(
            "LEASE_SECONDS", 15, most=LONGEST, expected=f"whole seconds from 1 to {LONGEST}"
        ),
        lease_pod=OwnPod(*pod) if pod else None,
        originals_key=environment.pair(
            "ORIGINALS_KEY", "a namespace and a Secret's name, such as contextpolicy-system/contextpolicy-originals"
        ),
        agents_everywhere=environment.word("AGENTS", ("any", "everywhere"), "any") == "everywhere",
        settle_seconds=environment.whole(
            "SETTLE_SECONDS", int(SETTLED), most=MOST_SETTLED, expected=f"whole seconds from 1 to {MOST_SETTLED}"
        ),
        identity=environment.text("IDENTITY", gethostname()),
        log_format=environment.word("LOG_FORMAT", LOG_FORMATS, "text"),
        log_level=environment.word("LOG_LEVEL", LOG_LEVELS, "info"),
    )
    _require_distinct(
        environment, HEALTH_PORT=settings.health_port, METRICS_PORT=settings.metrics_port, LIVE_PORT=settings.live_port
    )
    environment.check()
    return settings


def _require_distinct(environment: Environment, **ports: int) -> None:
    """Two servers can't listen on one port."""
    for one, other in combinations(ports, 2):
        if ports[one] == ports[other]:
            environment.findings.append(Finding(other, str(ports[other]), f"a port other than {one}"))
