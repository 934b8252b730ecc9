from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import zenoh

from timelines.demo.recorder import _collect


def a_sample(kind, payload=b""):
    return SimpleNamespace(kind=kind, payload=SimpleNamespace(to_bytes=lambda: payload))


def test_messages_are_collected_and_a_withdrawal_is_none():
    plans: list[dict[str, Any]] = []
    take = _collect(plans)
    take(a_sample(zenoh.SampleKind.PUT, json.dumps({"sequence": 1}).encode()))
    take(a_sample(zenoh.SampleKind.DELETE))
    assert plans == [{"sequence": 1}]
