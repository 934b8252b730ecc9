"""The originals as a policy's status holds them: entries by pod UID, each signed by the operator. Pure.

Anyone who may patch a status could write false originals there, and have a deleted policy "restore" it. So an entry
counts after a restart only with a signature by a key that tenants can't read, over all that it says, the policy and the
pod's UID.
"""

from __future__ import annotations

import hmac
import json
import logging
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from contextpolicy.cluster.pod_parsing import version_of
from contextpolicy.cluster.pods import Cpu
from contextpolicy.cluster.resource_quantities import millicores
from contextpolicy.policy.quantities import format_cpu

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

log = logging.getLogger(__name__)

FIELD = "originals"
"""Field of the status: pod UID -> the pod's name, its containers' CPU resources, and a signature."""

_DOMAIN = "contextpolicy original, version 1"


class StoredPod(NamedTuple):
    """One pod in a status: its name, its containers' originals, and whether an agent wrote their limits too."""

    pod: str
    containers: dict[str, Cpu]
    agent: bool = False
    signature: str = ""


@dataclass(frozen=True, slots=True)
class StoredOriginals:
    """`raw` is what a status holds in an object of this `version`; `pods` is what of it, or instead of it, is true.

    `unproven` are the pods, by UID, whose entries can neither be proven nor disproven, with the reason for people.
    """

    raw: Mapping[str, Any] = field(default_factory=dict)
    version: int = 0
    pods: Mapping[str, StoredPod] = field(default_factory=dict)
    unproven: Mapping[str, str] = field(default_factory=dict)


class EntrySignatures(Protocol):
    """Distinguishes the operator's entries from those of others."""

    def of(self, policy: str, uid: str, entry: StoredPod) -> str:
        """The signature of an entry; empty where nothing is signed."""

    def prove(self, policy: str, uid: str, entry: StoredPod) -> bool:
        """Whether the operator wrote this entry of the policy's status."""


class UnsignedOriginals:
    """Without a key: nothing is signed, and every entry is trusted."""

    def of(self, policy: str, uid: str, entry: StoredPod) -> str:  # noqa: ARG002 - the protocol's signature
        """No signature."""
        return ""

    def prove(self, policy: str, uid: str, entry: StoredPod) -> bool:  # noqa: ARG002 - the protocol's signature
        """Every entry is believed."""
        return True


class Signatures:
    """Signs entries with a key (HMAC-SHA256), and recognises its own."""

    def __init__(self, key: bytes) -> None:
        self._key = key

    def of(self, policy: str, uid: str, entry: StoredPod) -> str:
        """The signature of an entry."""
        containers = {name: [cpu.request, cpu.limit] for name, cpu in entry.containers.items()}
        said = [_DOMAIN, policy, uid, entry.pod, containers, entry.agent]
        return hmac.digest(self._key, json.dumps(said, sort_keys=True).encode(), "sha256").hex()

    def prove(self, policy: str, uid: str, entry: StoredPod) -> bool:
        """Whether the operator wrote this entry of the policy's status."""
        return hmac.compare_digest(entry.signature.encode(), self.of(policy, uid, entry).encode())


def signatures_with(key: bytes | None) -> EntrySignatures:
    """The signatures by a key; None where the operator has none."""
    return UnsignedOriginals() if key is None else Signatures(key)


def raw_of(body: Mapping[str, Any]) -> dict[str, Any]:
    """The originals of a ContextPolicy object, whatever they are."""
    found = (body.get("status") or {}).get(FIELD)
    return found if isinstance(found, dict) else {}


def stored_in(body: Mapping[str, Any]) -> StoredOriginals:
    """What a ContextPolicy object holds."""
    return StoredOriginals(raw_of(body), version_of(body["metadata"]), {})


def read(policy: str, stored: object) -> Iterator[tuple[str, StoredPod]]:
    """The entries of a status by pod UID; an invalid entry is logged and left out."""
    for uid, entry in stored.items() if isinstance(stored, dict) else ():
        try:
            containers = {name: _cpu(cpu) for name, cpu in entry["containers"].items()}
            signature = str(entry.get("signature") or "")
            yield uid, StoredPod(str(entry["pod"]), containers, entry.get("agent") is True, signature)
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            log.warning("%s: status.%s.%s can't be read: %r", policy, FIELD, uid, error)


def certain(held: Mapping[str, Any]) -> dict[tuple[str, str], Cpu]:
    """By pod UID and container name, the originals that a status holds beyond doubt."""
    found = {}
    for uid, entry in held.items():
        containers = entry.get("containers") if isinstance(entry, dict) else None
        for name, cpu in containers.items() if isinstance(containers, dict) else ():
            try:
                found[uid, name] = _cpu(cpu)
            except (ValueError, TypeError, AttributeError):
                continue
    return found


def write(entry: StoredPod) -> dict[str, Any]:
    """An entry as the status holds it."""
    containers = {name: quantities(cpu) for name, cpu in entry.containers.items()}
    more: dict[str, Any] = {"agent": True} if entry.agent else {}
    return {"pod": entry.pod, "containers": containers} | more | _named("signature", entry.signature)


def quantities(cpu: Cpu) -> dict[str, str]:
    """CPU resources as Kubernetes quantities."""
    amounts = {"request": cpu.request, "limit": cpu.limit}
    return {kind: format_cpu(amount) for kind, amount in amounts.items() if amount is not None}


def _named(name: str, value: str) -> dict[str, str]:
    return {name: value} if value else {}


def _cpu(cpu: Mapping[str, Any]) -> Cpu:
    return Cpu(millicores(cpu.get("request")), millicores(cpu.get("limit")))
