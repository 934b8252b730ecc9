"""CEL as policies use it: functions, errors, and what is read."""

from __future__ import annotations

import re

import pytest

from contextpolicy.errors import ExpressionError
from contextpolicy.planning.conditions.expressions import Guarded
from contextpolicy.planning.conditions.scope import Scope
from contextpolicy.policy.cel import Expression
from tests.planning.conditions.evaluating import evaluate


@pytest.mark.parametrize(
    ("source", "value"),
    [
        ("norm(imu.v)", 5.0),
        ("norm(imu.xy)", 5.0),
        ("abs(imu.n)", 2.5),
        ("min(imu.v)", 0.0),
        ("max(imu.v)", 4.0),
        ("min(imu.n, 7.0)", -2.5),
        ("sqrt(16.0)", 4.0),
        ("imu.v.exists(x, x > 3.0)", True),
        ("imu.v.filter(x, x > 0.0).size()", 2),
        ("has(imu.n) && !has(imu.m)", True),
        ("imu.word.matches('^wo')", True),
        ("'word' in [imu.word]", True),
        ("imu['n']", -2.5),
        ("imu['low-g']", 1.0),
        ('imu["it\'s"]', 2.0),
        ("imu['in'] + imu['true']", 7.0),
        ("imu['größe']", 5.0),
        ("has(imu['xy'].x) && !has(imu['xy'].z)", True),
        ("{'a b': imu['n']}['a b']", -2.5),
        ("imu.n < 0.0 ? imu.word : imu.m", "word"),
    ],
)
def test_values(source, value):
    sample = {"v": [3.0, 4.0, 0.0], "xy": {"x": 3.0, "y": 4.0}, "n": -2.5, "word": "word"}
    sample |= {"low-g": 1.0, "it's": 2.0, "in": 3.0, "true": 4.0, "größe": 5.0}
    assert evaluate(source, imu=sample) == value


@pytest.mark.parametrize(
    ("source", "why"),
    [
        ("imu.missing > 1", "the sample has no field 'missing'"),
        ("imu['low-g'] > 1", "the sample has no field 'low-g'"),
        ("imu.word > 1", "overload"),
        ("norm(imu.word)", "expected a list or a map of numbers"),
        ("1 % imu.zero", "% by zero"),
        ("1 % 1.5", "1.5 is an operand of %; expected integers"),
        ("imu.word + 1", "string + float"),
        ("imu.list[9]", "9"),
        ("sqrt(-1.0)", "expected a number of 0 or more"),
        ("mic.level > 1", "mic"),
    ],
)
def test_failures_are_expression_errors_that_name_the_source(source, why):
    with pytest.raises(ExpressionError) as caught:
        evaluate(source, imu={"word": "abc", "zero": 0, "list": [1]})
    assert str(caught.value).startswith(f"{source}: ")
    assert why in str(caught.value)


@pytest.mark.parametrize("value", [1, "true", None, 1.0])
def test_a_condition_must_be_a_boolean(value):
    scope = Scope()
    condition = scope.compile("imu.a")
    scope.bind("imu", {"a": value})
    with pytest.raises(ExpressionError, match="expected true or false"):
        condition.truth(scope)


@pytest.mark.parametrize("source", ["", " ", "imu.", "a b", "(", "imu.x = 1", "1 +", "\x00", "👾", "imu.`x`"])
def test_an_invalid_expression_is_a_value_error(source):
    with pytest.raises(ValueError, match=r"."):
        Expression(source)


def test_unknown_functions_are_named():
    assert Expression("median(imu.x) > sin(1.0) && size(imu.y) > 1").unknown_functions == {"median", "sin"}


@pytest.mark.parametrize(
    ("source", "reads"),
    [
        ("imu.gyro.x > 1.0 && mic.level > 1.0", {"imu.gyro.x", "mic.level"}),
        ("norm(imu.gyro)", {"imu.gyro"}),
        ("norm(imu)", {"imu"}),
        ("imu['gyro'].x", {"imu.gyro.x"}),
        ('imu["low-g"]["x"]', {"imu.low-g.x"}),
        ("imu['gyro' + imu.axis]", {"imu", "imu.axis"}),
        ("has(imu.gyro)", {"imu.gyro"}),
        ("scan.ranges.exists(r, r < scan.near)", {"scan.ranges", "scan.near"}),
        ("a.l.map(x, x.y).exists(z, z == b.q)", {"a.l", "b.q"}),
        ("a.l.all(x, x > 0) && x.y", {"a.l", "x.y"}),
        ("a.name.startsWith('b.c') && r'\\' != a.d // e.f", {"a.name", "a.d"}),
        ("a.l[b.i].c", {"a.l", "b.i"}),
        ("{'k': a.x}.k == [a.y][0]", {"a.x", "a.y"}),
        ("true && null != 1.5e-3", set()),
    ],
)
def test_reads_of_an_expression(source, reads):
    assert {".".join(path) for path in Expression(source).reads} == reads


def test_only_fields_that_are_read_reach_cel():
    scope = Scope()
    scope.compile("imu.a.b > 1.0")
    scope.bind("imu", {"a": {"b": 2.0, "c": object()}, "d": object()})
    assert scope.size("imu") == 3
    scope.compile("imu.a == imu.a")
    scope.bind("imu", {"a": {"b": 2.0, "c": 1.0}, "d": object()})
    assert scope.size("imu") == 5


def test_a_failing_guard_reports_each_time_and_recovery_once():
    reported: list[str] = []

    class Listener:
        def on_expression_error(self, source, reason):
            reported.append(f"{source}! {reason}")

        def on_expression_recovery(self, source):
            reported.append(f"{source} again")

        def on_elapsed(self, _):
            raise AssertionError  # a guard sets no timer

    scope = Scope()
    guarded = Guarded(scope.compile("a.b ? a.c : a.d"), scope, Listener())
    for sample in ({}, {}, {"b": True, "c": True}, {"b": True, "c": True}):
        scope.bind("a", sample)
        guarded.truth(0.0)
    missing = "a.b ? a.c : a.d! the sample has no field 'b'"
    assert reported == [missing, missing, "a.b ? a.c : a.d again"]


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        ("size(imu.a) > 1", "size of True; expected a string, bytes, a list or a map"),
        ("norm(imu.a) > 1.0", "norm: of True; expected a list or a map of numbers"),
        ("min(imu.l) > 1.0", "min: of []; expected at least one number"),
        ("max(imu.l) > 1.0", "max: of []; expected at least one number"),
        ("sqrt(imu.n) > 1.0", "sqrt: of -4.0; expected a number of 0 or more"),
    ],
)
def test_functions_say_what_they_expected(source, reason):
    scope = Scope()
    condition = scope.compile(source)
    scope.bind("imu", {"a": True, "l": [], "n": -4.0})
    with pytest.raises(ExpressionError, match=re.escape(reason)):
        condition.truth(scope)


@pytest.mark.parametrize("character", ["\r", "\x1b", "\x00", "\u202e", "\u2028", "\xa0"])
def test_an_invisible_character_is_refused_and_named(character):
    with pytest.raises(ValueError, match=rf"U\+{ord(character):04X} at character 10; in a string, write \\u"):
        Expression(f"x.s == '1{character}2'")


def test_an_expression_may_have_several_lines():
    assert evaluate("x.s == '1'\n\t&& x.s != '2'", x={"s": "1"}) is True
