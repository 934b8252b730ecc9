"""Features that nothing reads: they cost with every sample."""

from __future__ import annotations

import pytest

from tests.policy.validation.loops import IMU, a_context, advised

SHAKING = {"name": "shaking", "op": "count", "over": "1s"}


@pytest.mark.parametrize(
    ("when", "read"),
    [
        ("imu.shaking > 2", True),
        ("imu['shaking'] > 2", True),
        ('imu["shaking"] > 2', True),
        ("imu.shakings > 2", False),
        ("imu['x'] > 2", False),
    ],
)
def test_a_feature_is_read_by_dot_or_index(when, read):
    reported = advised(streams=[{**IMU, "features": [SHAKING]}], contexts=[a_context(when=when)])
    assert ("nothing reads imu.shaking, which costs time with every sample" not in reported) is read
