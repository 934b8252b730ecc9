"""A patch makes the wanted object of whichever object is there."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.actuators.resize.merge_patch import UNSURE, either, merge_patch
from tests.actuators.resize.fake_cluster import merged

KEYS = st.sampled_from("abc")
LEAVES = st.sampled_from(["1", "2", True])
OBJECTS = st.recursive(
    st.dictionaries(KEYS, LEAVES, max_size=3),
    lambda inside: st.dictionaries(KEYS, LEAVES | inside, max_size=3),
    max_leaves=8,
)


@given(OBJECTS, OBJECTS)
def test_merge_patch_turns_held_values_into_the_wanted_ones(wanted, held):
    assert merged(held, merge_patch(wanted, held)) == wanted


@given(OBJECTS, OBJECTS, OBJECTS)
def test_merge_patch_works_for_either_held_value(wanted, one, other):
    patch = merge_patch(wanted, either(one, other))
    assert [merged(held, patch) for held in (one, other)] == [wanted, wanted]


@given(OBJECTS)
def test_equal_objects_give_an_empty_patch(wanted):
    assert merge_patch(wanted, wanted) == {}
    assert merge_patch(wanted, either(wanted, wanted)) == {}


def test_field_in_only_one_object_is_unsure():
    assert either({"a": "1", "b": {"c": "1"}}, {"a": "1"}) == {"a": "1", "b": {"c": UNSURE}}
