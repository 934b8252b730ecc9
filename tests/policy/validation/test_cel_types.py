"""The kinds of expressions: what fits is never refused, what does not is told with the operand."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.policy.cel import Expression
from contextpolicy.policy.ros_types import type_store
from contextpolicy.policy.validation.cel_types import mistakes
from contextpolicy.policy.validation.shapes import BOOL, NUMBER, TEXT, of_example, of_message

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
def test_what_fits_is_never_refused(source):
    assert mistakes(source, BOOL, SHAPES) == []


@given(numbers, texts)
def test_what_does_not_fit_is_told(number, text):
    assert mistakes(f"(1.0 + {number}) < ('a' + {text})", BOOL, SHAPES) != []
    assert mistakes(f"1.0 + {number}", TEXT, SHAPES) != []


@given(st.text("s.nxtbl()[]{}+-*/<>=!&|?:,' 12e", max_size=40))
def test_nothing_that_compiles_crashes_it(source):
    try:
        Expression(source)
    except ValueError:
        return
    mistakes(source, NUMBER, SHAPES)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("s.m.boxes.exists(b, b.h > 1)", "b has no field h: its example has w"),
        ("s.m.boxes.exists(b, b.w)", "b.w is a number, allowed there: true or false"),
        (
            "imu.header.stamp.secs > 1",
            "imu.header.stamp has no field secs: builtin_interfaces/msg/Time has sec,",
        ),
        ("imu.orientation_covariance.x > 1.0", "imu.orientation_covariance is a list, which has no field x"),
        ("s.t > 1", "s.t > 1 has a text and a number: > takes two of a kind"),
        ("s.n ? true : false", "s.n is a number, allowed there: true or false"),
        ("'a' in s.t", "s.t is a text, allowed there: a list or a map"),
        ("s.x.startsWith('a')", "s.x is a number, allowed there: a text"),
        ("s.any.matches('[')", "'[' is no regular expression"),
        ("s.n[0] > 1", "s.n is a number, allowed there: a list or a map"),
        ("s['tt'] == 'go'", "s has no field tt: its example has"),
        ("norm(s.l, s.l) > 1", "a call such as norm(imu.gyro); this is norm(s.l, s.l)"),
        ("contains(s.t, 'a')", "a call such as imu.frame.contains('link'); this is contains(s.t, 'a')"),
        ("s.l.contains('a')", "s.l is a list, allowed there: a text"),
    ],
)
def test_each_mistake_names_the_operand(source, message):
    (told,) = mistakes(source, BOOL, SHAPES)
    assert told.startswith(message)
