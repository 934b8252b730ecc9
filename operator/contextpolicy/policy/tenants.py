"""What administrators decide about namespaces: whose policies come first on a node, and what their streams may read.

It comes with the operator's installation, so users who can write a policy or label a pod can't change it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from contextpolicy.errors import Finding
from contextpolicy.policy.fields import Fields

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from contextpolicy.policy.spec import Policy

OTHERS = "*"
"""Stands for every namespace that is not listed."""
OWN_NAME = "{namespace}"
"""Stands for the policy's namespace in a prefix."""


@dataclass(frozen=True, slots=True)
class Tenant:
    """One namespace: of greater `priority` first; `stream_prefixes` are None where they are not listed."""

    priority: int = 0
    stream_prefixes: tuple[str, ...] | None = None


@dataclass(frozen=True, slots=True)
class Tenants:
    """All namespaces that were listed, by name. By default, all are alike and may read any key."""

    listed: Mapping[str, Tenant] = field(default_factory=dict)

    def priority(self, namespace: str) -> int:
        """Policies of a greater one are served first."""
        return self._get(namespace).priority

    def stream_prefixes(self, namespace: str) -> tuple[str, ...] | None:
        """The first chunks of the keys that the namespace's streams may read; None: any.

        As soon as prefixes are listed for one namespace, others read nothing but what is listed for them or for all.
        """
        if all(tenant.stream_prefixes is None for tenant in self.listed.values()):
            return None
        own = self._get(namespace).stream_prefixes
        allowed = own if own is not None else self.listed.get(OTHERS, Tenant()).stream_prefixes or ()
        return tuple(prefix.replace(OWN_NAME, namespace) for prefix in allowed)

    def findings(self, policy: Policy) -> Iterator[Finding]:
        """Every key of the policy that its namespace may not read."""
        prefixes = self.stream_prefixes(policy.namespace)
        if prefixes is None:
            return
        keys = ", ".join(f"{prefix}/**" for prefix in prefixes) or "no stream"
        for field_, key in _keys(policy):
            if not any(f"{key}/".startswith(f"{prefix}/") for prefix in prefixes):
                expected = f"a key that the administrator lets namespace {policy.namespace} read: {keys}"
                yield Finding(field_, key, expected)

    def _get(self, namespace: str) -> Tenant:
        return self.listed.get(namespace) or self.listed.get(OTHERS) or Tenant()


def _keys(policy: Policy) -> Iterator[tuple[str, str]]:
    """Every key that the operator reads for the policy, by the field that names it."""
    for index, stream in enumerate(policy.streams):
        yield f"spec.streams[{index}].key", stream.key
        if stream.liveliness is not None:
            yield f"spec.streams[{index}].liveliness", stream.liveliness
    if policy.shadow is not None:
        yield "spec.shadow.health", policy.shadow.health


def read_tenants(text: str, findings: list[Finding]) -> Tenants:
    """Read a JSON object such as `{"lab": {"priority": 10, "streamPrefixes": ["robot"]}}`; notes what is wrong."""
    try:
        listed = json.loads(text)
    except ValueError as error:
        findings.append(Finding("TENANTS", text, f"a JSON object; {error}"))
        return Tenants()
    namespaces = Fields({"TENANTS": listed}, "", findings).mapping("TENANTS", limit=10_000)
    return Tenants({name: _tenant(fields) for name, fields in namespaces.items()})


def _tenant(fields: Fields) -> Tenant:
    priority = fields.number("priority") or 0.0
    if not priority.is_integer():
        fields.refuse("priority", priority, "an integer")
    prefixes = fields.texts("streamPrefixes", limit=64) if "streamPrefixes" in fields else fields.raw("streamPrefixes")
    for prefix in prefixes or ():
        if set(prefix) & set("*$?#") or prefix != prefix.strip("/"):
            fields.refuse("streamPrefixes", prefix, "the first chunks of keys without wildcards, such as robot/arm")
    fields.close()
    return Tenant(int(priority), prefixes)
