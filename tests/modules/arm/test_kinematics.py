from __future__ import annotations

import math

import pytest
from hypothesis import given
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
def test_postures_whose_place_anybody_can_tell(angles, point):
    assert forward(LINKS, angles) == pytest.approx(point, abs=1e-9)


@given(st.floats(-90, 90), st.floats(0, 135), st.floats(1, 179))
def test_inverse_undoes_forward(base, shoulder, bend):
    angles = Angles(base, shoulder, shoulder - bend)
    point = forward(LINKS, angles)
    if math.hypot(point[0], point[1]) > 1 and math.hypot(point[0], point[1]) - LINKS.offset > -LINKS.offset + 1:
        found = inverse(LINKS, point)
        if forward(LINKS, Angles(base, 0, 0))[0] * point[0] + forward(LINKS, Angles(base, 0, 0))[1] * point[1] > 0:
            assert forward(LINKS, found) == pytest.approx(point, abs=1e-6)
            assert (found.base, found.shoulder, found.elbow) == pytest.approx((base, shoulder, angles.elbow), abs=1e-3)


@given(st.floats(-300, 300), st.floats(-300, 300), st.floats(-300, 300))
def test_any_point_is_reached_exactly_or_refused(x, y, z):
    try:
        angles = inverse(LINKS, (x, y, z))
    except Unreachable:
        assert not 0 < math.hypot(math.hypot(x, y) - 68, z) <= 160
    else:
        assert forward(LINKS, angles) == pytest.approx((x, y, z), abs=1e-6)


def test_a_point_too_far_away_is_told_with_what_the_arm_spans():
    with pytest.raises(Unreachable, match=r"position \(400, 0, 0\): 332 mm .* spans 0 to 160"):
        inverse(LINKS, (400, 0, 0))
