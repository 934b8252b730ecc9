"""The transition times of conditions."""

from __future__ import annotations

from contextpolicy.telemetry.api_text import timestamp
from contextpolicy.telemetry.status import (
    ConditionFinding,
    conditions,
)


def at(now, problems=(), previous=(), generation=1):
    return conditions([ConditionFinding("Accepted", "Valid", "Invalid", problems)], generation, previous, now)


def since(found):
    return {one["type"]: one["lastTransitionTime"] for one in found}


def test_a_transition_time_is_kept_while_the_state_lasts():
    first = at(0)
    later = at(100, previous=first, generation=2)
    assert since(later) == since(first) == {"Ready": timestamp(0), "Accepted": timestamp(0)}
    assert {one["observedGeneration"] for one in later} == {2}


def test_a_transition_time_moves_with_the_state_not_with_its_reason():
    good = at(0)
    bad = at(10, ["a"], good)
    other = at(20, ["b"], bad)
    good_again = at(30, previous=other)
    assert [since(found)["Accepted"] for found in (bad, other, good_again)] == [timestamp(n) for n in (10, 10, 30)]
    assert since(good_again)["Ready"] == timestamp(30)


def test_conditions_of_others_are_not_kept():
    foreign = {"type": "Foreign", "status": "True", "lastTransitionTime": timestamp(0)}
    assert [one["type"] for one in at(10, previous=[foreign])] == ["Ready", "Accepted"]
