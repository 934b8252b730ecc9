"""Zenoh key expressions as a policy writes them. Zenoh itself decides: its rules are finer than a pattern can tell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import zenoh

from contextpolicy.errors import Finding

if TYPE_CHECKING:
    from contextpolicy.policy.spec import Policy


def selects(expression: str, key: str) -> bool:
    """Whether `expression` selects `key`, a key without wildcards."""
    return zenoh.KeyExpr(expression).includes(zenoh.KeyExpr(key))


def key_findings(policy: Policy) -> list[Finding]:
    """The key expressions that Zenoh refuses, with its reasons."""
    findings = []
    for index, stream in enumerate(policy.streams):
        for field, key in (("key", stream.key), ("liveliness", stream.liveliness)):
            reason = "" if key is None else _refusal(key)
            if reason:
                findings.append(Finding(f"spec.streams[{index}].{field}", key, f"a Zenoh key expression; {reason}"))
    return findings


def _refusal(key: str) -> str:
    try:
        zenoh.KeyExpr(key)
    except zenoh.ZError as error:
        return str(error).partition(" at /")[0]
    return ""
