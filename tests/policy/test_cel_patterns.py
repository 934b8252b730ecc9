"""What regular expressions may cost."""

from __future__ import annotations

import time
from contextlib import suppress

import pytest

from contextpolicy.errors import ExpressionError
from contextpolicy.planning.conditions.scope import Scope
from contextpolicy.policy.cel import Expression
from contextpolicy.policy.cel_patterns import steps

WORDS = r"(\\w+\\w+)+(\\w+\\w+)+(\\w+\\w+)+(\\w+\\w+)+"


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        (f'x.l.exists(a, a.matches("{WORDS}"))', "large patterns in them"),
        ("[" + ",".join(['"-"'] * 60) + r'].exists(a, a.matches("\\w+\\w+"))', "large patterns in them"),
        (" || ".join([f'x.s.matches("{WORDS}")'] * 14), "too long to compile"),
        (r'x.s.matches("(\\w\x7b60\x7d)\x7b60\x7d")', "counted repetitions"),
        (r'x.s.matches("(?i)[\u0100-\uffff]+[\u0100-\uffff]+[\u0100-\uffff]+[\u0100-\uffff]+")', "too long to compile"),
        (f'x.s.matches("{"a" * 65}")', "more than 64 characters"),
        ('x.s.matches(b"a")', "not a string in quotes"),
    ],
)
def test_a_pattern_that_takes_long_to_compile_is_refused(source, reason):
    with pytest.raises(ValueError, match=reason):
        Expression(source)


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ('x.l.exists(a, a.matches("^(person|car|dog)$"))', 400),
        (r'x.l.exists(a, a.matches("^\\w+$"))', 30),
        (" && ".join([r'x.s.matches("\\w+\\w+")'] * 14), 1000),
        ('x.s.matches("(?i)person")', 10_000),
        (f"x.s.matches('{'.?' * 32}')", 10_000),
    ],
)
def test_a_pattern_for_names_is_allowed_on_samples_of_usual_size(source, count):
    scope = Scope()
    expression = scope.compile(source)
    scope.bind("x", {"l": ["-"] * count, "s": "a" * count})
    expression.truth(scope)


@pytest.mark.parametrize(
    "source",
    [
        f'x.s.matches("{WORDS}")',
        r'x.l.exists(a, a.matches("\\w+"))',
        'x.l.exists(a, a.matches("(?i)person|.*car.*|dog"))',
        " || ".join(["x.s.matches('b')"] * 20),
        r'x.s.matches("(?i)[\u0100-\uffff]+[\u0100-\uffff]+")',
    ],
)
def test_a_pattern_is_bounded_on_the_largest_sample_it_accepts(source):
    scope = Scope()
    expression = scope.compile(source)
    for count in (100_000, 20_000, 5_000, 2_500, 600, 250, 120, 60, 35, 20, 10):
        scope.bind("x", {"l": ["-"] * count, "s": "a" * 32 * count})
        begin = time.thread_time()
        with suppress(ExpressionError):
            expression.evaluate(scope)
        assert time.thread_time() - begin < 2.0  # a runaway takes half a minute


def test_classes_of_letters_cost_more_than_characters():
    assert steps('"imu_"') < steps(r'"\\d"') < steps('"(?i)imu_"') < steps(r'"\\w"') == steps(r"r'\w'")
