"""Kubernetes Events about a ContextPolicy, as values. Pure."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Any

from contextpolicy.policy.custom_resource import API_VERSION
from contextpolicy.telemetry.api_text import MAX_MESSAGE, timestamp

if TYPE_CHECKING:
    from collections.abc import Mapping

MAX_NAME = 240
"""Characters of the policy's name in the event's: both may have 253, and the digest needs 13."""


def event(policy: Mapping[str, Any], *, reason: str, message: str, now: float, warning: bool = True) -> dict[str, Any]:
    """An Event on the policy object `policy`; equal reason, message and second give an equal name."""
    metadata = policy["metadata"]
    digest = hashlib.sha256(f"{reason}{message}{now:.0f}".encode()).hexdigest()[:12]
    return {
        "metadata": {"name": f"{metadata['name'][:MAX_NAME]}.{digest}", "namespace": metadata["namespace"]},
        "involvedObject": {
            "apiVersion": policy.get("apiVersion", API_VERSION),
            "kind": policy.get("kind", "ContextPolicy"),
            "name": metadata["name"],
            "namespace": metadata["namespace"],
            "uid": metadata.get("uid", ""),
        },
        "type": "Warning" if warning else "Normal",
        "reason": reason,
        "message": message[:MAX_MESSAGE],
        "source": {"component": "contextpolicy"},
        "firstTimestamp": timestamp(now),
        "lastTimestamp": timestamp(now),
        "count": 1,
    }
