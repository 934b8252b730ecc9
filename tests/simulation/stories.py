"""Small policies and timelines to simulate."""

from __future__ import annotations

from typing import Any

from contextpolicy.policy.parsing import parse
from contextpolicy.streams import timeline


def a_policy(*streams: dict[str, Any], tasks: tuple[str, ...] = ("a",), needs: Any = None, **spec: Any) -> Any:
    """Each task with a container of its own; `needs` are the first one's."""
    items = [{"name": name, "selector": {"matchLabels": {"app": name}}} for name in tasks]
    if needs:
        items[0]["needs"] = needs
    return parse(
        {"metadata": {"name": "p", "namespace": "n"}, "spec": {"streams": list(streams), "tasks": items, **spec}}
    )


def a_context(when: str, **effects: Any) -> dict[str, Any]:
    return {"name": "c", "when": when, "tasks": effects}


def at(time: float, value: Any, key: str = "s") -> dict[str, Any]:
    return {"key": key, "encoding": "json", "at": time, "value": value}


def a_timeline(*inputs: dict[str, Any], duration: float = 10, name: str = "t") -> timeline.Timeline:
    return timeline.parse({"name": name, "duration": duration, "inputs": list(inputs)})
