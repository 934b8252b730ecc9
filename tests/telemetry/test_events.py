from __future__ import annotations

from typing import Any

from contextpolicy.telemetry.api_text import MAX_MESSAGE
from contextpolicy.telemetry.events import event

POLICY: dict[str, Any] = {
    "apiVersion": "contextpolicy.dev/v1alpha1",
    "kind": "ContextPolicy",
    "metadata": {"name": "robot", "namespace": "lab", "uid": "u-1"},
}
NOW = 1_763_712_350.123


def test_an_event_names_its_policy():
    made = event(POLICY, reason="Invalid", message="no tasks", now=NOW)
    assert made["involvedObject"] == {
        "apiVersion": "contextpolicy.dev/v1alpha1",
        "kind": "ContextPolicy",
        "name": "robot",
        "namespace": "lab",
        "uid": "u-1",
    }
    assert (made["type"], made["reason"], made["message"]) == ("Warning", "Invalid", "no tasks")
    assert made["firstTimestamp"] == made["lastTimestamp"] == "2025-11-21T08:05:50Z"
    assert made["metadata"]["namespace"] == "lab"


def test_good_news_is_a_normal_event():
    assert event(POLICY, reason="Recovered", message="", now=NOW, warning=False)["type"] == "Normal"


def test_a_long_message_is_cut_to_what_the_api_accepts():
    assert len(event(POLICY, reason="Invalid", message="x" * 5000, now=NOW)["message"]) == MAX_MESSAGE == 1024


def test_equal_events_have_equal_names():
    def name(reason="Invalid", message="a", now=NOW):
        return event(POLICY, reason=reason, message=message, now=now)["metadata"]["name"]

    assert name() == name(now=NOW + 0.1)
    assert len({name(), name(message="b"), name(reason="Conflicted"), name(now=NOW + 5)}) == 4


def test_the_longest_policy_name_still_makes_a_name_for_an_event():
    long = {**POLICY, "metadata": {**POLICY["metadata"], "name": "r" * 253}}
    assert len(event(long, reason="Invalid", message="", now=NOW)["metadata"]["name"]) <= 253
