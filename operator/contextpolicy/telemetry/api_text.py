"""Times and messages as Kubernetes takes them in a status or an Event."""

from __future__ import annotations

from datetime import UTC, datetime

MAX_MESSAGE = 1024
"""Characters of a message."""


def timestamp(moment: float) -> str:
    """Unix seconds as RFC 3339 with whole seconds, as metav1.Time wants it."""
    return datetime.fromtimestamp(moment, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
