"""What is shown of a value, however large it is."""

from __future__ import annotations

import json

import pytest

from contextpolicy.explain.excerpt import LONGEST_MAP, LONGEST_TEXT, excerpt


@pytest.mark.parametrize(
    "value",
    [None, True, 0, -1.5, 2**64, "", "drive", {"a": {"b": [1, 2.5, "x", None]}}, list(range(16)), {}, []],
    ids=repr,
)
def test_small_value_is_unchanged(value):
    assert excerpt(value) == value


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (b"abc", "3 bytes"),
        (float("nan"), "NaN"),
        (float("inf"), "Infinity"),
        (float("-inf"), "-Infinity"),
        (2**2000, "an integer of 2001 bits"),
        (list(range(20)), [*range(16), "and 4 more"]),
        ("x" * 1000, "x" * LONGEST_TEXT + "... and 744 more"),
        ({"x" * 1000: 1}, {"x" * LONGEST_TEXT + "... and 744 more": 1}),
        (
            {f"{n}": n for n in range(1000)},
            {**{f"{n}": n for n in range(LONGEST_MAP)}, "...": f"and {1000 - LONGEST_MAP} more"},
        ),
    ],
    ids=["bytes", "nan", "inf", "-inf", "integer", "list", "text", "key", "map"],
)
def test_large_value_is_named_or_cut(value, shown):
    assert excerpt(value) == shown


@pytest.mark.parametrize(
    "value",
    [
        ["x" * 900_000] * 1000,
        {f"{n:05}": "x" * 900_000 for n in range(1000)},
        {f"{n:0900}": {f"{m:0900}": m for m in range(100)} for n in range(100)},
        [[[["x" * 1000] * 16] * 16] * 16] * 16,
        [[[2**1024 - 1] * 16] * 16] * 16,
    ],
    ids=["texts", "texts in a map", "long keys", "nested lists", "integers"],
)
def test_excerpt_size_is_bounded(value):
    assert len(json.dumps(excerpt(value))) < 200_000
