"""Bounds against expressions that run away, and any text as a source."""

from __future__ import annotations

import time
from contextlib import suppress

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
]


@pytest.mark.parametrize("source", COSTLY)
def test_accepted_expressions_have_bounded_cost(source):
    """The worst found is some 50 ms of CPU on the machine that this was written on; a runaway takes minutes."""
    scope = Scope()
    expression = scope.compile(source)
    for count in (10_000, 2_500, 600, 250, 170, 120, 60, 35, 20, 10):
        scope.bind("x", {"l": [1.5] * count, "s": "a" * 32 * count})
        begin = time.thread_time()
        with suppress(ExpressionError):
            expression.evaluate(scope)
        assert time.thread_time() - begin < 2.0


def test_the_message_names_the_size_and_what_is_allowed():
    with pytest.raises(ExpressionError, match=r"reads 502 values: expected at most 39, given its cost"):
        evaluate("x.l.map(a, x.l).size() > 0", x={"l": [1.0] * 500})


def test_a_plain_condition_over_a_whole_laser_scan_is_allowed():
    scan = {"ranges": [2.0] * 1440, "intensities": [1.0] * 1440, "range_min": 0.1}
    source = "scan.ranges.exists(r, r < 0.5 && r > scan.range_min)"
    assert evaluate(source, scan=scan) is False


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
