"""What has not changed is not evaluated again, and a failure is reported each time."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.planning.conditions.expressions import Guarded
from contextpolicy.planning.conditions.scope import Scope, is_same


class Recorder:
    """Counts failures and recoveries."""

    def __init__(self):
        self.errors = []

    def on_expression_error(self, _, reason):
        self.errors.append(reason)

    def on_expression_recovery(self, _):
        self.errors.append("recovered")

    def on_elapsed(self, _):
        raise AssertionError  # a guard sets no timer


def counted(source, scope):
    """An expression, and a list with an entry for each evaluation."""
    expression, evaluations = scope.compile(source), []

    def truth(scope):
        evaluations.append(1)
        return expression.truth(scope)

    own = {name: getattr(expression, name) for name in ("source", "variables", "contexts", "ages", "number")}
    counting: Any = SimpleNamespace(**own, truth=truth)
    return Guarded(counting, scope, Recorder()), evaluations


def test_an_unchanged_sample_is_not_evaluated_again():
    scope = Scope()
    guarded, evaluations = counted("imu.speed > 0.1", scope)
    for number in range(3):
        scope.bind("imu", {"speed": 0.3, "stamp": number}, float(number))
        assert guarded.truth(float(number)) is True
    assert len(evaluations) == 1, "it does not read the stamp"
    scope.bind("imu", {"speed": 0.05, "stamp": 3}, 3.0)
    assert (guarded.truth(3.0), len(evaluations)) == (False, 2)


def test_any_of_its_streams_may_change_its_value():
    scope = Scope()
    guarded, evaluations = counted("imu.speed > 0.1 && mic.level > 0.5", scope)
    scope.bind("imu", {"speed": 0.3})
    scope.bind("mic", {"level": 0.6})
    assert guarded.truth(0.0) is True
    scope.bind("mic", {"level": 0.4})
    assert guarded.truth(1.0) is False
    scope.unbind("imu")
    scope.bind("mic", {"level": 0.6})
    assert (guarded.truth(2.0), guarded.waiting.stream, len(evaluations)) == (False, "imu", 3)


def test_an_age_changes_without_any_sample():
    scope = Scope()
    guarded, _ = counted("age(imu) > 2", scope)
    scope.bind("imu", {}, 10.0)
    assert [guarded.truth(now) for now in (11.0, 12.0, 12.5)] == [False, False, True]


def test_heard_changes_when_a_stream_falls_silent():
    scope = Scope()
    guarded, _ = counted("heard(imu)", scope)
    seen = [guarded.truth(0.0)]
    scope.bind("imu", {})
    seen.append(guarded.truth(1.0))
    scope.unbind("imu")
    seen.append(guarded.truth(2.0))
    assert seen == [False, True, False]


def test_a_feature_that_loses_its_last_sample_is_a_change():
    scope = Scope()
    guarded, _ = counted("imu.shake > 1.0", scope)
    scope.bind("imu", {"shake": 2.0})
    assert guarded.truth(0.0) is True
    scope.bind("imu", {}, 1.0, ["shake"])
    assert (guarded.truth(1.0), guarded.waiting.reason) == (False, "imu.shake has no sample in its window")


def test_a_failure_is_reported_with_each_sample_however_alike():
    scope, reported = Scope(), Recorder()
    guarded = Guarded(scope.compile("imu.speed > 0.1"), scope, reported)
    for now in range(3):
        scope.bind("imu", {"speed": "fast"}, float(now))
        assert guarded.truth(float(now)) is False
    assert len(reported.errors) == 3


@pytest.mark.parametrize(
    ("one", "other"),
    [
        *[(True, 1), (True, 1.0), (0.0, -0.0), (1, 1.0), ([1], [True]), ([0.0], [-0.0]), ({"a": 1}, {"a": True})],
        *[({"a": 1}, {"b": 1}), ({"a": 1}, {"a": 1, "b": 2}), ([1, 2], [2, 1]), ("1", 1), ("", None), ({}, [])],
    ],
)
def test_values_that_expressions_distinguish_are_not_the_same(one, other):
    assert not is_same(one, other)
    assert not is_same(other, one)


SAMPLES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-2, 2)
    | st.sampled_from([0.0, -0.0, 1.0, 2.0, math.inf, math.nan, "", "a"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from("ab"), inner, max_size=2),
    max_leaves=6,
)


@given(SAMPLES, SAMPLES)
def test_values_that_are_the_same_have_the_same_repr(one, other):
    """`repr` distinguishes all that expressions can, and the order of keys, which they can't."""
    if is_same(one, other):
        assert repr(_sorted(one)) == repr(_sorted(other))


@given(SAMPLES)
def test_a_value_is_the_same_as_itself(value):
    assert is_same(value, value)


def _sorted(value):
    if isinstance(value, dict):
        return {name: _sorted(value[name]) for name in sorted(value)}
    return [_sorted(inner) for inner in value] if isinstance(value, list) else value
