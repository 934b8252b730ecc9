"""What a checkup of a cluster starts from, and what it comes to, as values."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from contextpolicy.cluster.pods import PodView
    from contextpolicy.cluster.serving import Service


class Verdict(StrEnum):
    """How a check ended; `unknown` is one that could not be made."""

    OK = "ok"
    WARNING = "warning"
    BAD = "bad"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Check:
    """One finding: about what, what was seen, and what to do about it (empty when nothing)."""

    subject: str
    verdict: Verdict
    seen: str
    remedy: str = ""


@dataclass(frozen=True, slots=True)
class ClusterFacts:
    """Objects as the API has them. None where the caller may not read them: their checks are `unknown`.

    `lacking` are the operator's rights that are missing, as `verb resource`; `kubelets` the configuration of each
    node's kubelet and its metrics as text; `pods` are views of those of the policies' namespaces; `definition` is the
    CustomResourceDefinition; `deployments` are the operators', read where none has a pod; `services` says by namespace
    whether an operator serves its policies. `ends` says by Secret (namespace/name) when the certificate that a part
    mounts ends, None where it can't be read; `now` is the time.
    """

    version: str
    policies: Sequence[Mapping[str, Any]] | None
    operators: Sequence[Mapping[str, Any]] | None
    routers: Sequence[Mapping[str, Any]] | None
    nodes: Sequence[Mapping[str, Any]] | None
    lacking: Sequence[str] | None
    kubelets: Mapping[str, tuple[Mapping[str, Any], str]] = field(default_factory=dict)
    serves_policies: bool = True
    pods: Sequence[PodView] | None = ()
    definition: Mapping[str, Any] | None = None
    deployments: Sequence[Mapping[str, Any]] | None = None
    services: Mapping[str, Service] = field(default_factory=dict)
    ends: Mapping[str, datetime | None] = field(default_factory=dict)
    now: datetime = datetime(1970, 1, 1, tzinfo=UTC)


def conditions(policy: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    """Those of a policy's status."""
    return (policy.get("status") or {}).get("conditions") or ()


def name_of(body: Mapping[str, Any]) -> str:
    """An object's namespace and name."""
    return f"{body['metadata']['namespace']}/{body['metadata']['name']}"
