from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from modules.navigation.obstacles import RADIUS, SLOW_GAP, STOP_GAP, gap, held_back
from modules.navigation.waypoints import Motion


def scan(**seen):
    """A scan of 360 ranges; `at_90=1.5` puts something there."""
    ranges = [0.0] * 360
    for name, distance in seen.items():
        ranges[int(name.removeprefix("at_"))] = distance
    return ranges


def test_the_gap_is_measured_from_the_robots_edge():
    assert gap(scan(at_0=1.0)) == pytest.approx(1.0 - RADIUS)


def test_obstacles_beside_or_behind_are_ignored():
    assert gap(scan(at_90=0.25, at_180=0.3, at_270=0.25, at_30=1.0)) == math.inf


def test_driving_backward_uses_the_gap_behind():
    assert gap(scan(at_180=0.5, at_0=0.3), backward=True) == pytest.approx(0.5 - RADIUS)


def test_an_empty_scan_means_free_space():
    assert gap(scan()) == gap([]) == math.inf


def test_the_speed_falls_with_the_gap_and_is_zero_close_by():
    motion = Motion(0.2, 0.5)
    assert held_back(motion, SLOW_GAP) == motion
    half = held_back(motion, (SLOW_GAP + STOP_GAP) / 2)
    assert (half.forward, half.turn) == pytest.approx((0.1, 0.25))
    assert held_back(motion, STOP_GAP) == Motion()


def test_turning_on_the_spot_is_always_allowed():
    assert held_back(Motion(0, 1), 0.0) == Motion(0, 1)


@given(st.lists(st.floats(0, 12), max_size=720), st.floats(-0.5, 0.5), st.floats(-2, 2))
def test_an_obstacle_never_makes_the_robot_faster(ranges, forward, turn):
    held = held_back(Motion(forward, turn), gap(ranges, backward=forward < 0))
    assert abs(held.forward) <= abs(forward)
    assert abs(held.turn) <= abs(turn)
