"""A number is a number: no expression shows how a sensor or a policy spelled it."""

from __future__ import annotations

import json
import math
from fractions import Fraction

import cbor2
import ormsgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.errors import ExpressionError
from contextpolicy.planning.conditions.scope import Scope
from contextpolicy.policy import cel_numbers
from contextpolicy.policy.cel import Expression
from contextpolicy.policy.stream_spec import Encoding, Stream
from contextpolicy.streams.decoding import Decoder


def evaluate(source, sample=None):
    scope = Scope()
    expression = scope.compile(source)
    scope.bind("n", sample or {})
    return expression.evaluate(scope)


def outcome(source, sample=None):
    """The value, or that there is none."""
    try:
        value = evaluate(source, sample)
    except ExpressionError:
        return "no value"
    return "not a number" if isinstance(value, float) and math.isnan(value) else value


@pytest.mark.parametrize("spelling", [3, 3.0])
@pytest.mark.parametrize(
    ("source", "value"),
    [
        ("n.v / 2", 1.5),
        ("n.v / 2.0", 1.5),
        ("n.v * 2.0 > 1.0", True),
        ("n.v * 2 == 6.0", True),
        ("n.v + 0.5 - 1", 2.5),
        ("-n.v", -3.0),
        ("1 - -n.v", 4.0),
        ("n.v % 2", 1),
        ("-n.v % 2", -1),
        ("7 % -n.v", 1),
        ("n.l[n.v - 2]", 20),
        ("n.l[n.v - 2.0] / 8", 2.5),
        ("n.l[1.0]", 20),
        ("{3: 'three'}[n.v]", "three"),
        ("{n.v: 'three'}[3.0]", "three"),
        ("n.v in [1, 2, 3.0]", True),
        ("n.v in {3: true}", True),
        ("size(n.l) / 2", 1.5),
        ("n.l.size() * 0.5 > 1", True),
        ("n.l[size(n.l) - 1]", 30),
        ("n.l[int(n.v) - 1] + int('2')", 32),
        ("n.l == [10.0, 20, 3e1]", True),
        ("n.l.map(x, x * 0.1).exists(x, x > 2)", True),
        ("max(1.0, n.v)", 3),
        ("min(2, n.v, 4.0)", 2),
        ("min(2.0, 4.0 / max(1.0, n.v))", 4 / 3),
        ("n.v == 3u && 2u < n.v && n.v + 1u == 4", True),
        ("n.v > 2 ? n.v : 0", 3),
        ("0x10 + n.v", 19),
        ("n.v / 0 > 1e300", True),
        ("string(n.v) + 'rd'", "3rd"),
        ("type(n.v) == type(1)", True),
        ("n.v + 9007199254740992", 9007199254740995),
    ],
)
def test_arithmetic_is_on_real_numbers(source, value, spelling):
    assert evaluate(source, {"v": spelling, "l": [10, 20.0, 30]}) == value


@pytest.mark.parametrize("source", ["n.v % 2", "7 % n.v", "n.l[n.v]", "true + 1", "1 + 'a'", "'a' * 2", "n.b - 1"])
def test_invalid_input_has_no_value(source):
    assert outcome(source, {"v": 1.5, "l": [1, 2, 3], "b": True}) == "no value"


@pytest.mark.parametrize("source", ["'a' + 'b' == 'ab'", "[1] + [2.0] == [1, 2]", "b'a' + b'b' == b'ab'"])
@pytest.mark.parametrize("more", ["", " && size('a') + 1 == 2", " && 9007199254740993 - 1 == 9007199254740992"])
def test_plus_still_joins_texts_and_lists(source, more):
    assert evaluate(source + more) is True


def test_times_and_durations_are_as_ever():
    later = "timestamp('2026-01-01T00:00:00Z') + duration('90s')"
    for more in ("", " && size('a') + 1 == 2"):
        assert evaluate(f"{later} == timestamp('2026-01-01T00:01:30Z'){more}") is True
        assert evaluate(f"{later} - timestamp('2026-01-01T00:00:00Z') == duration('90s'){more}") is True


BIG = 2**53


@pytest.mark.parametrize(
    ("source", "value"),
    [
        (f"n.a == {BIG + 1}", True),
        (f"n.a == {BIG}", False),
        (f"n.a > {BIG}", True),
        (f"n.a > {float(BIG)!r}", True),
        (f"n.a == {float(BIG)!r}", False),
        ("n.b - n.a", 2),
        ("(n.b - n.a) / 4", 0.5),
        ("n.b - 1 == n.a + 1", True),
        ("n.a % 10", 3),
        ("n.a % 10 == 3.0", True),
        ("n.a in [n.b, 9007199254740993]", True),
        ("n.u == 18446744073709551615u", True),
        ("n.u > 18446744073709551614u", True),
        ("n.u > n.a", True),
        ("-n.a == -9007199254740993", True),
        ("n.stamp / 1000000000 > 1764000000.1", True),
        ("n.stamp - 1764000000000000000 == 123456789", True),
        ("n.few * 2.0", 3.0),
        ("[9007199254740993].map(v, v + 1) == [9007199254740994]", True),
        ("[9007199254740993][0] + 1 == 9007199254740994", True),
        ("['ab'].map(v, size(v)).all(w, w / 4 == 0.5)", True),
        ("(n.few > 1 ? 9007199254740993 : 1) + 1 == 9007199254740994", True),
        ("max(9007199254740993, n.few) - 1 == 9007199254740992", True),
        ("{'a': 9007199254740993}.a + 2 == 9007199254740995", True),
    ],
)
def test_whole_numbers_of_64_bits_are_exact(source, value):
    sample = {"a": BIG + 1, "b": BIG + 3, "u": 2**64 - 1, "stamp": 1_764_000_000_123_456_789, "few": 1.5}
    assert evaluate(source, sample) == value


# Properties: expressions whose numbers are spelled twice.

wholes = st.one_of(
    st.integers(-9, 9),
    st.integers(-(2**63), 2**64 - 1),
    st.sampled_from([b + d for b in (BIG, 2**62, 2**63) for d in (-1, 0, 1, 2)]),
)
doubles = st.one_of(st.sampled_from([0.5, 1.5, 0.1, 1e300, 2.0**53, 2.0**60, -(2.0**53)]), st.floats(-1e20, 1e20))
numbers = st.one_of(wholes, doubles)


def spellings(number):
    """All ways to write a number that is at least 0 into a policy."""
    whole = int(number) == number
    texts = [f"{number!r}" if isinstance(number, float) else ""]
    if whole and number < 2**63:
        texts += [str(int(number)), hex(int(number))]
    if whole and number < 2**64:
        texts += [f"{int(number)}u", f"{hex(int(number))}u"]
    if float(number) == number:
        texts += [repr(float(number)), f"{float(number):.25e}"]
    return [text for text in texts if text]


def values(number):
    """All ways in which a payload can hold it."""
    same = [number]
    if float(number) == number:
        same.append(float(number))
    if int(number) == number:
        same.append(int(number))
    return same


LEAF, FIELD = "leaf", "field"
operands = st.recursive(
    st.one_of(
        st.tuples(st.just(LEAF), numbers.map(abs)),
        st.tuples(st.just(FIELD), st.sampled_from("abc")),
    ),
    lambda below: st.one_of(
        st.tuples(st.sampled_from(["({} + {})", "({} - {})", "({} * {})", "({} / {})", "({} % {})"]), below, below),
        st.tuples(st.sampled_from(["-{}", "abs({})", "double({})", "int({})", "[{}, 1][0]", "n.l[{}]"]), below),
        st.tuples(st.sampled_from(["max({}, {})", "min({}, {})", "({} < {} ? 1 : 2)", "norm([{}, {}])"]), below, below),
    ),
    max_leaves=6,
)
comparisons = st.tuples(
    st.sampled_from(["{} < {}", "{} <= {}", "{} == {}", "{} != {}", "{} > {}", "{} >= {}", "{} in [{}, 1]"]),
    operands,
    operands,
)


def written(tree, choose):
    """The source of a tree; `choose` picks each number's spelling."""
    head, *rest = tree
    if head == LEAF:
        return choose(spellings(rest[0]))
    return f"n.{rest[0]}" if head == FIELD else head.format(*(written(part, choose) for part in rest))


@given(st.one_of(operands, comparisons), st.fixed_dictionaries({"a": numbers, "b": numbers, "c": numbers}), st.data())
def test_the_value_does_not_depend_on_how_numbers_are_spelled(tree, sample, data):
    def choose(options):
        return data.draw(st.sampled_from(options))

    seen = []
    for _ in range(2):
        fields = {name: choose(values(number)) for name, number in sample.items()}
        fields["l"] = [choose(values(number)) for number in (4, 5.5, BIG + 2)]
        seen.append(outcome(written(tree, choose), fields))
    assert seen[0] == seen[1]


def value_of(tree, sample):
    """What real numbers give; None where it is no whole eighth or leaves the doubles' exact range on the way."""
    head, *rest = tree
    if head == LEAF:
        return Fraction(rest[0])
    if head == FIELD:
        return Fraction(sample[rest[0]])
    left, right = (value_of(part, sample) for part in rest)
    if left is None or right is None or (right == 0 and head == "({} / {})"):
        return None
    result = {
        "({} + {})": lambda: left + right,
        "({} - {})": lambda: left - right,
        "({} * {})": lambda: left * right,
        "({} / {})": lambda: left / right,
    }[head]()
    return result if (result * 2**20).denominator == 1 and abs(result) < 2**20 else None


small = st.one_of(st.integers(0, 64), st.integers(0, 64).map(lambda n: n / 8))
exact_trees = st.recursive(
    st.one_of(st.tuples(st.just(LEAF), small), st.tuples(st.just(FIELD), st.sampled_from("abc"))),
    lambda below: st.tuples(st.sampled_from(["({} + {})", "({} - {})", "({} * {})", "({} / {})"]), below, below),
    max_leaves=5,
)


@given(exact_trees, st.fixed_dictionaries({"a": small, "b": small, "c": small}), st.booleans(), st.data())
def test_results_match_exact_arithmetic(tree, sample, functions, data):
    """Both by the library's arithmetic and by ours, which an integer from 2^53 on switches to."""
    expected = value_of(tree, sample)
    source = written(tree, lambda options: data.draw(st.sampled_from(options)))
    if expected is not None:
        assert outcome(source, {**sample, "big": BIG + 1}) == float(expected)
        with_big = f"n.big == {BIG + 1} ? {source} : 0" if functions else f"{source} + size('')"
        assert outcome(with_big, {**sample, "big": BIG + 1}) == float(expected)


@given(numbers, numbers)
def test_comparisons_match_exact_arithmetic(left, right):
    for sample in ({"a": a, "b": b} for a in values(left) for b in values(right)):
        assert evaluate("n.a < n.b", sample) is (Fraction(left) < Fraction(right))
        assert evaluate("n.a == n.b", sample) is (Fraction(left) == Fraction(right))


@given(numbers)
def test_each_number_has_one_form(number):
    forms = [cel_numbers.normal(value) for value in values(number)]
    assert len({(type(form), form) for form in forms}) == 1
    assert Fraction(forms[0]) == Fraction(number)


@pytest.mark.parametrize(
    ("encoding", "write"),
    [("json", lambda v: json.dumps(v).encode()), ("cbor", cbor2.dumps), ("msgpack", ormsgpack.packb)],
)
@pytest.mark.parametrize("value", [3, 3.0])
def test_all_encodings_give_the_same_numbers(encoding, write, value):
    sample = Decoder(Stream("n", "robot/n", Encoding(encoding))).decode(write({"v": value, "l": [value, 1]}))
    assert evaluate("n.v / 2 == 1.5 && n.l[0] * 0.5 == 1.5 && norm(n.l) > 3", sample.value) is True


@pytest.mark.parametrize(
    "source",
    ["age(n) + 1 > 2", "age(n) > n.v", "age(n) == 2", "age(n)", "age(n.v) > 2", "age() > 2", "heard(n.v)", "heard(1)"],
)
def test_an_age_that_time_cannot_decide_is_refused(source):
    with pytest.raises(ValueError, match=r"such as (age|heard)\(imu\)"):
        Expression(source)
