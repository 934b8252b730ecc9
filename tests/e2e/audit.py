"""What an account asked of the API server, by its audit log, and what it may ask by its roles."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, NamedTuple

from tests.e2e.cluster import get, run
from tests.node.layout import AUDIT_LOG

if TYPE_CHECKING:
    from collections.abc import Iterator

    Right = tuple[str, str, str]
    """API group, resource with its subresource, verb."""

ALLOWED = "allow"


class Call(NamedTuple):
    """One request; `decision` is that of the authorization, not of admission or of the object's own rules."""

    right: Right
    namespace: str
    decision: str
    at: str


def calls(account: str, namespace: str) -> list[Call]:
    """All that this very account asked of objects since it was created: one of the same name before it is another."""
    identity = get("serviceaccount", account, namespace)["metadata"]["uid"]
    return [_call(entry) for entry in _entries() if entry["user"].get("uid") == identity and "objectRef" in entry]


def rights(account: str) -> set[tuple[str, Right]]:
    """What the roles that are bound to the account's name grant: namespace (empty: all of them) and right."""
    kinds = ("clusterrolebinding,rolebinding", "clusterrole,role")
    bindings, roles = (json.loads(run("kubectl", "get", kind, "-A", "-o", "json"))["items"] for kind in kinds)
    known = {(role["kind"], role["metadata"].get("namespace", ""), role["metadata"]["name"]): role for role in roles}
    granted = set()
    for binding in bindings:
        if account in (subject["name"] for subject in binding.get("subjects", [])):
            where, of = binding["metadata"].get("namespace", ""), binding["roleRef"]
            role = known[of["kind"], where if of["kind"] == "Role" else "", of["name"]]
            granted |= {(where, right) for right in _rights(role)}
    return granted


def _rights(role: dict[str, Any]) -> Iterator[Right]:
    for rule in role["rules"]:
        yield from ((g, r, v) for g in rule["apiGroups"] for r in rule["resources"] for v in rule["verbs"])


def _entries() -> Iterator[dict[str, Any]]:
    """The log with what was rotated away; a request that is under way has an entry for its start too."""
    for file in sorted(AUDIT_LOG.parent.glob(f"{AUDIT_LOG.stem}*{AUDIT_LOG.suffix}")):
        with file.open(encoding="utf-8") as lines:
            yield from (json.loads(line) for line in lines if line.endswith("\n"))


def _call(entry: dict[str, Any]) -> Call:
    on = entry["objectRef"]
    resource = "/".join(filter(None, (on["resource"], on.get("subresource"))))
    decision = entry.get("annotations", {}).get("authorization.k8s.io/decision", "")
    right = on.get("apiGroup", ""), resource, entry["verb"]
    return Call(right, on.get("namespace", ""), decision, entry["requestReceivedTimestamp"])
