"""What QoS a publisher of ROS offers, from its liveliness token (robotkit.ros_graph has the format). Pure."""

from __future__ import annotations

from typing import Any

TOKENS = "@ros2_lv/*/**"
"""Of all nodes, publishers and subscriptions that rmw_zenoh knows."""
_INFINITE = ("9223372036", "854775807")
_RELIABILITY = {"0": "system_default", "1": "reliable", "2": "best_effort"}
_DURABILITY = {"0": "system_default", "1": "transient_local", "2": "volatile"}
_HISTORY = {"0": "system_default", "1": "keep_last", "2": "keep_all"}
_LIVELINESS = {"0": "system_default", "1": "automatic", "3": "manual_by_topic"}
_UNKNOWN = "unknown"


def offer_of(token: str) -> tuple[str, dict[str, Any]] | None:
    """A publisher's topic and its QoS as rosbag2 writes it; None for another token, or one that makes no sense."""
    parts = token.split("/")
    if len(parts) < 13 or parts[0] != "@ros2_lv" or parts[5] != "MP":
        return None
    try:
        return parts[9].replace("%", "/"), _profile(parts[12])
    except ValueError:
        return None


def _profile(text: str) -> dict[str, Any]:
    """`<reliability>:<durability>:<history>,<depth>:<deadline>:<lifespan>:<liveliness>,<lease>`; empty: the default."""
    reliability, durability, history, deadline, lifespan, liveliness = text.split(":")
    kept, depth = history.split(",")
    lively, *lease = liveliness.split(",")
    return {
        "history": _HISTORY.get(kept or "1", _UNKNOWN),
        "depth": int(depth or 42),
        "reliability": _RELIABILITY.get(reliability or "1", _UNKNOWN),
        "durability": _DURABILITY.get(durability or "2", _UNKNOWN),
        "deadline": _time(deadline.split(",")),
        "lifespan": _time(lifespan.split(",")),
        "liveliness": _LIVELINESS.get(lively or "1", _UNKNOWN),
        "liveliness_lease_duration": _time(lease),
        "avoid_ros_namespace_conventions": False,
    }


def _time(parts: list[str]) -> dict[str, int]:
    seconds, nanoseconds = (given or default for given, default in zip(parts, _INFINITE, strict=True))
    return {"sec": int(seconds), "nsec": int(nanoseconds)}
