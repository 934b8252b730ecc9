from __future__ import annotations

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from modules.arm.kinematics import Angles, Links, Unreachable, forward, inverse

LINKS = Links(upper_arm=80, forearm=80, offset=68)


@pytest.mark.parametrize(
    ("angles", "point"),
    [
        (Angles(0, 0, 0), (228, 0, 0)),
        (Angles(0, 90, 0), (148, 0, 80)),
        (Angles(90, 90, 0), (0, 148, 80)),
        (Angles(-90, 90, -90), (0, -68, 0)),
        (Angles(0, 90, 90), (68, 0, 160)),
    ],
)
def test_forward_kinematics_of_simple_postures(angles, point):
    assert forward(LINKS, angles) == pytest.approx(point, abs=1e-9)


@given(st.floats(-90, 90), st.floats(0, 135), st.floats(1, 179))
def test_inverse_undoes_forward(base, shoulder, bend):
    elbow = shoulder - bend
    point = forward(LINKS, Angles(base, shoulder, elbow))
    assume(forward(LINKS, Angles(0, shoulder, elbow))[0] > 1)  # in front of the base
    found = inverse(LINKS, point)
    assert forward(LINKS, found) == pytest.approx(point, abs=1e-6)
    apart = (found.base - base, found.shoulder - shoulder, found.elbow - elbow)
    assert [math.remainder(angle, 360) for angle in apart] == pytest.approx([0, 0, 0], abs=1e-3)


@given(st.floats(-300, 300), st.floats(-300, 300), st.floats(-300, 300))
def test_any_point_is_reached_exactly_or_refused(x, y, z):
    try:
        angles = inverse(LINKS, (x, y, z))
    except Unreachable:
        assert not 0 < math.hypot(math.hypot(x, y) - 68, z) <= 160
    else:
        assert forward(LINKS, angles) == pytest.approx((x, y, z), abs=1e-6)


def test_a_point_too_far_away_is_reported_with_what_the_arm_spans():
    with pytest.raises(Unreachable, match=r"position \(400, 0, 0\): 332 mm .* expected 0 to 160"):
        inverse(LINKS, (400, 0, 0))
