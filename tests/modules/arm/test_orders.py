from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from modules.arm.orders import Order, parse_order
from robotkit import MessageError
from tests.modules.arm.test_joints import ARM

HOME = ARM.posture_at(ARM.home, grip=0)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.sampled_from(["stop", "move", "grip", "home", "relax"]), inner),
)


def parsed(document):
    return parse_order(json.dumps(document).encode(), ARM, HOME)


def test_orders():
    assert parsed({"stop": True}) is Order.STOP
    assert parsed({"relax": True}) is Order.RELAX
    assert parsed({"home": True}) == HOME
    assert parsed({"grip": "open"}) == {**HOME, "grip": 90}
    assert parsed({"grip": 30}) == {**HOME, "grip": 30}
    goal = parsed({"move": [120, 50, 30], "grip": "closed"})
    assert ARM.grip_at(goal) == pytest.approx((120, 50, 30))
    assert goal["grip"] == 0


def test_an_order_may_have_a_timestamp():
    """As the player writes into all that it publishes."""
    assert parsed({"grip": "closed", "stamp": 1795362405239985872}) == {**HOME, "grip": 0}


@pytest.mark.parametrize(
    ("document", "problem"),
    [
        ({}, r"order: invalid value \{\}: expected"),
        ({"stamp": 1}, r"order: invalid value \{'stamp': 1\}: expected"),
        ([1], r"order: invalid value \[1\]: expected"),
        ({"move": [1, 2, 3], "home": True}, r"order: invalid value \{'move': .*\}: expected"),
        ({"move": [1, 2]}, r"move: invalid value \[1, 2\]: expected \[x, y, z\] in mm"),
        ({"move": [1, 2, "x"]}, r"move: invalid value \[1, 2, 'x'\]: expected \[x, y, z\] in mm"),
        ({"move": [500, 0, 0]}, r"position \(500, 0, 0\)"),
        ({"move": [150, 0, -100]}, "height: -100 mm: expected at least -60 mm"),
        ({"grip": "wide"}, "grip: invalid value 'wide': expected 0 to 90 degrees, open or closed"),
        ({"grip": 91}, "grip: 91.0 degrees: expected 0 to 90"),
    ],
)
def test_an_invalid_order_is_reported(document, problem):
    with pytest.raises(MessageError, match=problem):
        parsed(document)


def test_invalid_json_is_reported():
    with pytest.raises(MessageError, match="not JSON"):
        parse_order(b"\xff{", ARM, HOME)


@given(JSON)
def test_arbitrary_json_stays_within_the_limits(document):
    try:
        goal = parsed(document)
    except MessageError:
        return
    if not isinstance(goal, Order):
        assert ARM.checked(goal) == goal
