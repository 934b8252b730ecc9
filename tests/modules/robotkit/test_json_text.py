from __future__ import annotations

import json
import math
from types import MappingProxyType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from robotkit.json_text import dumps, loads

values = some.recursive(
    some.none() | some.booleans() | some.integers(-(2**63), 2**63 - 1) | some.floats() | some.text(),
    lambda inner: some.lists(inner) | some.dictionaries(some.text(), inner),
    max_leaves=20,
)


@given(values)
def test_output_is_strict_json(value):
    json.loads(dumps(value), parse_constant=pytest.fail)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ({"x": math.nan, "y": [math.inf, -math.inf, 1.5]}, '{"x": null, "y": [null, null, 1.5]}'),
        ({"n": np.float32(0.5), "i": np.int64(2**60)}, '{"n": 0.5, "i": 1152921504606846976}'),
        (np.array([1.0, np.nan]), "[1.0, null]"),
        ((np.float32("nan"), np.bool_(1)), "[null, true]"),
        (MappingProxyType({"a": math.nan}), '{"a": null}'),
    ],
)
def test_nan_and_numpy_numbers_are_encoded(value, text):
    assert dumps(value) == text


@given(values)
def test_encoded_values_can_be_decoded(value):
    assert json.dumps(loads(dumps(value))) == dumps(value)


@pytest.mark.parametrize(
    "text", [b"", b"\xff", b"{", "NaN", "[-Infinity]", b"[" * 100_000, b'{"a":' * 100_000, b"1" * 21, "-1" + "0" * 400]
)
def test_invalid_json_is_a_value_error(text):
    with pytest.raises(ValueError):  # noqa: PT011 - of any kind
        loads(text)


def test_unencodable_results_are_a_bug_of_the_module():
    with pytest.raises(TypeError, match="set"):
        dumps({"x": {1}})
