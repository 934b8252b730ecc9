"""Objects that nest more deeply than Python's decoder can follow."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.cluster.nesting import DEEPEST, loads, loads_shallow, shallow

DEEP = 10_000
"""Levels that the API server takes."""
NESTS = {"lists": "[" * DEEP + "]" * DEEP, "maps": '{"a":' * DEEP + "1" + "}" * DEEP}
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(), lambda v: st.lists(v) | st.dictionaries(st.text(), v)
)


@pytest.mark.parametrize("nest", NESTS.values(), ids=NESTS)
def test_what_is_too_deep_is_null_and_all_else_stays(nest):
    text = f'{{"before": "[\\"{{", "deep": [{nest}, {nest}], "after": [1, {{"b": []}}]}}'
    for found in (loads(text), loads(text.encode()), loads_shallow(text)):
        assert (found["before"], found["after"]) == ('["{', [1, {"b": []}])
        assert depth(found["deep"][1]) == DEEPEST - 2


def depth(value):
    levels = 0
    while isinstance(value, list | dict):
        levels += 1
        value = next(iter(value.values() if isinstance(value, dict) else value))
    return levels


@given(VALUES)
def test_ordinary_values_are_as_they_are(value):
    text = json.dumps(value, ensure_ascii=False)
    assert shallow(text) == text
    assert loads(text) == loads_shallow(text) == value


@pytest.mark.parametrize("text", ["", "{", "[" * DEEP, '"', "]", '["\\', "[" * DEEP + "]" * (DEEP - 1)])
def test_malformed_json_is_an_error(text):
    for read in (loads, loads_shallow):
        with pytest.raises(json.JSONDecodeError):
            read(text)


def test_a_long_text_is_skipped_at_once():
    text = json.dumps(["\\" * 500_000, "x" * 1_000_000, *([[]] * DEEPEST)])
    assert shallow(text) == text
