"""The kinds of expressions: what fits is never refused, what does not is reported with the operand."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.policy.cel import Expression
from contextpolicy.policy.ros_types import type_store
from contextpolicy.policy.validation.cel_types import mistakes
from contextpolicy.policy.validation.shapes import BOOL, MAP, NUMBER, PLAIN, TEXT, of_example, of_message

EXAMPLE = {"n": 1, "x": 0.5, "t": "go", "b": True, "l": [1, 2.5], "m": {"n": 2, "boxes": [{"w": 1}]}, "any": None}
SHAPES = {"s": of_example(EXAMPLE, "its example"), "imu": of_message(type_store(), "sensor_msgs/msg/Imu")}

NUMBERS: st.SearchStrategy[str] = st.deferred(lambda: numbers)
TEXTS: st.SearchStrategy[str] = st.deferred(lambda: texts)
BOOLS: st.SearchStrategy[str] = st.deferred(lambda: bools)


def fits(template, *parts):
    return st.tuples(*parts).map(lambda found: template.format(*found))


numbers: st.SearchStrategy[str] = st.one_of(
    st.sampled_from(["1", "2.5", "s.n", "s.x", "s.m.n", "s.l[0]", "s.any", "s.m['n']", "imu.angular_velocity.z"]),
    fits("({} + {})", NUMBERS, NUMBERS),
    fits("({} * {} - {})", NUMBERS, NUMBERS, NUMBERS),
    fits("-{}", NUMBERS),
    fits("min({}, {})", NUMBERS, NUMBERS),
    fits("size({})", TEXTS),
    fits("({} ? {} : {})", BOOLS, NUMBERS, NUMBERS),
    st.sampled_from(["norm(s.l)", "norm(imu.linear_acceleration)", "size(s.l)", "s.m.boxes.map(i, i.w)[0]"]),
)
texts: st.SearchStrategy[str] = st.one_of(
    st.sampled_from(["'a'", "s.t", "s.any", "imu.header.frame_id"]),
    fits("({} + {})", TEXTS, TEXTS),
    fits("string({})", NUMBERS),
)
bools: st.SearchStrategy[str] = st.one_of(
    st.sampled_from(["true", "s.b", "s.any", "has(s.n)", "s.m.boxes.exists(i, i.w > 0)", "(2 in s.l)", "(s.any == 1)"]),
    fits("({} < {})", NUMBERS, NUMBERS),
    fits("({} == {})", TEXTS, TEXTS),
    fits("({} && {} || !{})", BOOLS, BOOLS, BOOLS),
    fits("{}.startsWith({})", TEXTS, TEXTS),
    fits("{}.matches('a+')", TEXTS),
)


@given(bools)
def test_well_typed_expressions_are_never_refused(source):
    assert mistakes(source, BOOL, SHAPES) == []


@given(numbers, texts)
def test_mismatched_kinds_are_reported(number, text):
    assert mistakes(f"(1.0 + {number}) < ('a' + {text})", BOOL, SHAPES) != []
    assert mistakes(f"1.0 + {number}", TEXT, SHAPES) != []


@given(st.text("s.nxtbl()[]{}+-*/<>=!&|?:,' 12e", max_size=40))
def test_arbitrary_expressions_do_not_crash_it(source):
    try:
        Expression(source)
    except ValueError:
        return
    mistakes(source, NUMBER, SHAPES)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("s.m.boxes.exists(b, b.h > 1)", "b has no field h: its example has w"),
        ("s.m.boxes.exists(b, b.w)", "b.w is a number, expected true or false"),
        (
            "imu.header.stamp.secs > 1",
            "imu.header.stamp has no field secs: builtin_interfaces/msg/Time has sec,",
        ),
        ("imu.orientation_covariance.x > 1.0", "imu.orientation_covariance is a list, which has no field x"),
        ("s.t > 1", "s.t > 1 has a string and a number: > takes two values of the same kind"),
        ("s.n ? true : false", "s.n is a number, expected true or false"),
        ("'a' in s.t", "s.t is a string, expected a list or a map"),
        ("s.x.startsWith('a')", "s.x is a number, expected a string"),
        ("s.any.matches('[')", "'[' is not a valid regular expression"),
        ("s.n[0] > 1", "s.n is a number, expected a list or a map"),
        ("s['tt'] == 'go'", "s has no field tt: its example has"),
        ("norm(s.l, s.l) > 1", "expected a call such as norm(imu.gyro), not norm(s.l, s.l)"),
        ("contains(s.t, 'a')", "expected a call such as imu.frame.contains('link'), not contains(s.t, 'a')"),
        ("s.l.contains('a')", "s.l is a list, expected a string"),
    ],
)
def test_each_mistake_names_the_operand(source, message):
    (reported,) = mistakes(source, BOOL, SHAPES)
    assert reported.startswith(message)


@pytest.mark.parametrize("source", ["s[0] > 5", "s.m[0] > 5"])
def test_a_map_of_a_sample_has_no_items(source):
    (reported,) = mistakes(source, BOOL, SHAPES)
    assert "is a map, whose fields have names, not numbers" in reported
    assert mistakes("{0: 7}[0] > 5 && s.l[0] > 5", BOOL, SHAPES) == []


PLAIN_LIST = {"s": of_example({"value": [1, 2, 3]}, PLAIN)}
PLAIN_NUMBER = {"s": of_example({"value": 5}, PLAIN)}
UNKNOWN = {"s": MAP}


@pytest.mark.parametrize(
    ("source", "shapes"),
    [
        ("size(s) > 2", PLAIN_LIST),
        ("s.size() > 2", PLAIN_NUMBER),
        ("norm(s) > 2.0", PLAIN_LIST),
        ("'a' in s", PLAIN_LIST),
        ("s.exists(x, x == 'a')", PLAIN_LIST),
        ("s.map(x, x)[0] == 'a'", PLAIN_LIST),
        ("3 in s", UNKNOWN),
        ("s in [3, 4]", UNKNOWN),
        ("s in ['a']", PLAIN_LIST),
        ("s.exists(x, x > 2)", UNKNOWN),
        ("s.filter(x, x > 2).size() > 1", UNKNOWN),
        ("s.all(x, x.ok)", UNKNOWN),
    ],
)
def test_a_plain_value_is_neither_a_list_nor_a_number(source, shapes):
    (reported,) = mistakes(source, BOOL, shapes)
    assert "such as 5, is read as s.value" in reported


@pytest.mark.parametrize("source", ["'a' in s", "s.exists(x, x == 'a')", "size(s) > 2", "norm(s) > 2.0", "s.l in [3]"])
def test_values_that_may_be_maps_are_not_refused(source):
    assert mistakes(source, BOOL, UNKNOWN) == []


@pytest.mark.parametrize(
    "source", ["3 in s.value", "s.value.exists(x, x > 2)", "size(s.value) > 2", "norm(s.value) > 2.0"]
)
def test_a_plain_list_may_be_used_as_a_list(source):
    assert mistakes(source, BOOL, PLAIN_LIST) == []


@pytest.mark.parametrize("source", ["'a' in s.l", "s.x in [1, 2]"])
def test_membership_of_another_type_is_reported(source):
    shapes = {"s": of_example({"l": [1, 2], "x": "a"}, "its example")}
    (reported,) = mistakes(source, BOOL, shapes)
    assert "is a string, and everything in" in reported
