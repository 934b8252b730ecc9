"""CEL as policies use it: functions, errors, what is read, and bounds against expressions that run away."""

from __future__ import annotations

import math
import time
from contextlib import suppress
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.errors import ExpressionError
from contextpolicy.planning.conditions.expressions import Guarded
from contextpolicy.planning.conditions.scope import Scope
from contextpolicy.policy import cel_cost, cel_syntax
from contextpolicy.policy.cel import Expression


def evaluate(source, **samples):
    scope = Scope()
    expression = scope.compile(source)
    for stream, value in samples.items():
        scope.bind(stream, value)
    return expression.evaluate(scope)


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
        ("imu.n < 0.0 ? imu.word : imu.m", "word"),
    ],
)
def test_values(source, value):
    sample = {"v": [3.0, 4.0, 0.0], "xy": {"x": 3.0, "y": 4.0}, "n": -2.5, "word": "word"}
    assert evaluate(source, imu=sample) == value


@pytest.mark.parametrize(
    ("source", "why"),
    [
        ("imu.missing > 1", "the sample has no field 'missing'"),
        ("imu.word > 1", "overload"),
        ("norm(imu.word)", "must be real number"),
        ("1 % imu.zero", "% by zero"),
        ("1 % 1.5", "1.5 is an operand of %, allowed: whole numbers"),
        ("imu.word + 1", "string + float"),
        ("imu.list[9]", "9"),
        ("sqrt(-1.0)", "math domain"),
        ("mic.level > 1", "mic"),
    ],
)
def test_failures_are_expression_errors_that_name_the_source(source, why):
    with pytest.raises(ExpressionError) as caught:
        evaluate(source, imu={"word": "abc", "zero": 0, "list": [1]})
    assert str(caught.value).startswith(f"{source}: ")
    assert why in str(caught.value)


@pytest.mark.parametrize("value", [1, "true", None, 1.0])
def test_a_condition_is_true_or_false_and_nothing_else(value):
    scope = Scope()
    condition = scope.compile("imu.a")
    scope.bind("imu", {"a": value})
    with pytest.raises(ExpressionError, match="allowed: true or false"):
        condition.truth(scope)


@pytest.mark.parametrize("source", ["", " ", "imu.", "a b", "(", "imu.x = 1", "1 +", "\x00", "👾", "imu.`x`"])
def test_what_does_not_compile_is_a_value_error(source):
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
        ("imu['gyro'].x", {"imu"}),
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
def test_what_an_expression_reads(source, reads):
    assert {".".join(path) for path in Expression(source).reads} == reads


def test_only_what_is_read_reaches_cel():
    scope = Scope()
    scope.compile("imu.a.b > 1.0")
    scope.bind("imu", {"a": {"b": 2.0, "c": object()}, "d": object()})
    assert scope.size("imu") == 3
    scope.compile("imu.a == imu.a")
    scope.bind("imu", {"a": {"b": 2.0, "c": 1.0}, "d": object()})
    assert scope.size("imu") == 5


def test_a_failing_guard_tells_each_time_and_recovery_once():
    told: list[str] = []

    class Listener:
        def on_expression_error(self, source, reason):
            told.append(f"{source}! {reason}")

        def on_expression_recovery(self, source):
            told.append(f"{source} again")

    scope = Scope()
    guarded = Guarded(scope.compile("a.b ? a.c : a.d"), scope, Listener())
    for sample in ({}, {}, {"b": True, "c": True}, {"b": True, "c": True}):
        scope.bind("a", sample)
        guarded.truth(0.0)
    missing = "a.b ? a.c : a.d! the sample has no field 'b'"
    assert told == [missing, missing, "a.b ? a.c : a.d again"]


@pytest.mark.parametrize(
    ("source", "truth"),
    [
        ("scan.near < 1.0", False),
        ("scan.near > 1.0", False),
        ("abs(scan.near) >= 0.0", True),
        ("!(scan.near < 1.0)", False),
        ("scan.near < 1.0 || scan.far > 1.0", True),
        ("scan.ranges.exists(r, r < 1.0)", True),
        ("scan.ranges.all(r, r > 0.1)", False),
        ("scan.far > 100.0 && !(scan.far < 100.0)", True),
        ("-scan.far < 0.0 && max(scan.far, 1.0) > 1.0", True),
    ],
)
def test_numbers_that_are_not_finite_compare_as_such_and_are_no_failure(source, truth):
    told: list[str] = []
    listener = SimpleNamespace(
        on_expression_error=lambda _, reason: told.append(reason), on_expression_recovery=told.append
    )
    scope = Scope()
    guarded, unknown = Guarded(scope.compile(source), scope, listener), scope.compile("scan.near != scan.near")
    scope.bind("scan", {"near": math.nan, "far": math.inf, "ranges": [math.nan, math.inf, 0.5]})
    assert (guarded.truth(0.0), told) == (truth, [])
    assert unknown.truth(scope), "the sample itself is as it was"


def test_a_real_mistake_is_told_beside_a_number_that_is_unknown():
    told: list[str] = []
    listener = SimpleNamespace(
        on_expression_error=lambda _, reason: told.append(reason), on_expression_recovery=told.append
    )
    scope = Scope()
    guarded = Guarded(scope.compile("scan.nearest < 1.0"), scope, listener)
    scope.bind("scan", {"near": math.nan})
    assert not guarded.truth(0.0)
    assert told == ["the sample has no field 'nearest'"]


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
def test_an_expression_that_runs_away_on_any_sample_is_refused(source):
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
def test_what_compiles_is_bounded_on_the_largest_sample_it_accepts(source):
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
    with pytest.raises(ExpressionError, match=r"reads 502 values, allowed for what it does with them: 39"):
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
def test_the_scan_ends_on_anything(source):
    """It runs after the compiler, but must not depend on its mercy."""
    with suppress(ValueError):
        cel_cost.read(cel_syntax.parse(source))
