"""Bounds against expressions that run away, and any text as a source."""

from __future__ import annotations

import time
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.errors import ExpressionError
from contextpolicy.planning.conditions.scope import Scope
from contextpolicy.policy import cel_cost, cel_syntax
from contextpolicy.policy.cel import Expression
from tests.planning.conditions.evaluating import evaluate

RUNAWAYS = [
    pytest.param("x.l.map(a, x.l.map(b, x.l.map(c, x.l)))", id="maps in maps"),
    pytest.param("x.l.all(a, x.l.all(b, x.l.all(c, x.l.all(d, x.l.all(e, x.l.all(f, true))))))", id="alls in alls"),
    pytest.param("x.l.map(a, x.l).map(a, x.l).map(a, x.l)", id="a chain of maps"),
    pytest.param("(" * 33 + "1" + ")" * 33, id="brackets"),
    pytest.param(" + ".join(["x.s"] * 18), id="sums"),
    pytest.param("x.s.matches(x.p)", id="a pattern from a payload"),
    pytest.param("x.s.matches('(a{0,100}){0,90}')", id="a pattern with counts"),
    pytest.param("x.s.matches('" + r"(a|b)*" * 20 + "')", id="a long pattern"),
    pytest.param("x" * 1025, id="long"),
]


@pytest.mark.parametrize("source", RUNAWAYS)
def test_an_expression_of_unbounded_cost_is_refused(source):
    with pytest.raises(ValueError, match=r"deep|adds|pattern|characters"):
        Expression(source)


COSTLY = [
    "x.l.all(a, a >= 0.0)",
    "x.l.map(a, a * 2.0).size() > 0",
    "x.l.map(a, a).size() > 0",
    "x.l.map(a, x.l).size() > 0",
    "x.l.filter(a, a >= 0.0).size() > 0",
    "x.l.all(a, x.l.all(b, a + b >= 0.0))",
    "x.l.all(a, x.l.map(b, b).size() >= 0)",
    "x.l.all(a, x.l == x.l)",
    "x.l.all(a, a in x.l)",
    "x.l.map(a, x.l.map(b, b)).size() > 0",
    "x.l.filter(a, a > 0.0).map(b, b).exists(c, c < 0.0)",
    "[x.l, x.l, x.l, x.l].all(a, a.all(b, b >= 0.0))",
    "[x.l, x.l, x.l, x.l].map(a, a).size() > 0",
    "(x.l + x.l + x.l + x.l).all(a, a >= 0.0)",
    "x.l.all(a, size(x.l + x.l + x.l) > 0)",
    " && ".join(["x.l.all(a, a >= 0.0)"] * 40),
    " && ".join(["x.l.map(a, a).size() > 0"] * 35),
    " + ".join(["x.l"] * 16) + " == []",
    " + ".join(["x.s"] * 16) + " == ''",
    "x.s.contains('b') || x.s.matches('(a*)*b') || x.s.matches('(.|a)*(.|a)*$')",
    r"x.s.matches('\\w\\w\\w\\w\\w\\w\\w\\w\\w\\w\\w\\w\\w\\w\\w\\w\\w\\w\\w')",
    "norm(x.l) > max(x.l) && x.l == x.l",
    "x.l.all(a, x.l[0] - x.l[1] < 1.0)",
    "x.l.all(a, {'l': x.l}.l[0] > 0.0)",
    "x.l.all(a, [x.l, x.l][0][0] > 0.0)",
    "[" + "1," * 380 + "1].all(a, " + "||".join(["x.d.d.d.d.d.d.l[0]<0.0"] * 9) + " || true)",
    "x.l.all(a, " + " || ".join(["x" + ".d" * depth + " > 0.0" for depth in range(1, 7)] * 5) + " || true)",
    "x.l.all(a, (a > 0.0 ? x.l : x.l)[0] * x.l[0] > 0.0)",
    "x.l.all(a, x.l > 0.0 || x.l < 0.0 || true)",
    "x.m.all(k, x.m[k] * x.m.k1 * x.m.k2 > 0.0)",
    "x.l.all(a, x.d.d.d.d.d.d.l[0] > 0.0)",
    " || ".join(["x.d.d.d.d.d.d.l[0]<0.0"] * 37),
    "||".join(["x.l[0]<0.0"] * 85),
]


def _a_sample(count: int) -> dict[str, Any]:
    numbers = [1.5] * count
    deep: dict[str, Any] = {"l": numbers}
    for _ in range(6):
        deep = {"d": deep}
    return {"l": numbers, "m": {f"k{index}": 1.5 for index in range(count)}, "s": "a" * 32 * count} | deep


@pytest.mark.parametrize("source", COSTLY)
def test_accepted_expressions_have_bounded_cost(source):
    """The worst found is some 50 ms of CPU on the machine that this was written on; a runaway takes minutes."""
    scope = Scope()
    expression = scope.compile(source)
    for count in (10_000, 2_500, 600, 250, 170, 120, 60, 35, 20, 10):
        scope.bind("x", _a_sample(count))
        begin = time.thread_time()
        with suppress(ExpressionError):
            expression.evaluate(scope)
        assert time.thread_time() - begin < 2.0


def test_the_message_names_the_size_and_what_is_allowed():
    with pytest.raises(ExpressionError, match=r"reads 502 values: expected at most 39, given its cost"):
        evaluate("x.l.map(a, x.l).size() > 0", x={"l": [1.0] * 500})


@pytest.mark.parametrize("least", ["scan.range_min", "scan.range.min", "imu.limits[0]"])
def test_a_plain_condition_over_a_whole_laser_scan_is_allowed(least):
    scan = {"ranges": [2.0] * 1440, "intensities": [1.0] * 1440, "range_min": 0.1, "range": {"min": 0.1}}
    source = f"scan.ranges.exists(r, r < 0.5 && r > {least})"
    assert evaluate(source, scan=scan, imu={"limits": [0.1, 3.0]}) is False


def test_a_few_beams_of_a_whole_laser_scan_may_be_named():
    scan = {"ranges": [2.0] * 4000}
    assert evaluate("[0, 1, 2, 3].exists(i, scan.ranges[i] < 0.5)", scan=scan) is False


TOKENS = st.sampled_from(
    [
        *("x", "x.l", "a", "true", "1.5", "'s'", ".map(", ".all(", ".exists(", "norm(", "has(", "matches("),
        *("(", ")", "[", "]", "{", "}", ",", ".", "+", "-", "==", "in", "?", ":", "&&", "||", "!"),
        *('"', "'", "'''", "//", "\n", "\\"),
    ]
)


@given(st.one_of(st.text(max_size=60), st.lists(TOKENS, max_size=30).map(" ".join), st.lists(TOKENS).map("".join)))
def test_no_source_crashes(source):
    with suppress(ValueError):
        Expression(source)


@given(st.lists(TOKENS, max_size=60).map("".join))
def test_the_cost_scan_terminates_on_any_input(source):
    """It runs after the compiler, but must not rely on it."""
    with suppress(ValueError):
        cel_cost.read(cel_syntax.parse(source))
