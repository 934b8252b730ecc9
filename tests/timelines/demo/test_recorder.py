from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import zenoh

from timelines.demo.recorder import _collect, note_limits


def a_sample(kind, payload=b""):
    return SimpleNamespace(kind=kind, payload=SimpleNamespace(to_bytes=lambda: payload))


def test_plans_are_collected_and_deletions_ignored():
    plans: list[dict[str, Any]] = []
    take = _collect(plans)
    take(a_sample(zenoh.SampleKind.PUT, json.dumps({"sequence": 1}).encode()))
    take(a_sample(zenoh.SampleKind.DELETE))
    assert plans == [{"sequence": 1}]


def test_a_limit_in_the_api_is_noted_when_it_changes():
    limits: dict[str, list[tuple[float, float]]] = {}
    for now, line in enumerate(("slam=300m guard=1 \n", "slam=300m guard=1 \n", "slam=10m guard= \n", "\n")):
        note_limits(limits, line, float(now))
    assert limits == {"slam": [(0.0, 0.3), (2.0, 0.01)], "guard": [(0.0, 1.0)]}
