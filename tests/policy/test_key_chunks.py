from __future__ import annotations

import pytest

from contextpolicy.policy.key_chunks import matched


@pytest.mark.parametrize(
    ("expression", "key", "expected"),
    [
        ("lift/*", "lift/left", "left"),
        ("*/lift/*", "r1/lift/left", "r1/left"),
        ("robot/*/lift", "robot/r1/lift", "r1"),
        ("robot/**", "robot/a/b", "a/b"),
        ("robot/**/lift", "robot/lift", ""),
        ("robot/**/lift", "robot/a/b/lift", "a/b"),
        ("**/lift/*", "a/lift/lift/left", "a/lift/left"),
        ("**", "a/b", "a/b"),
        ("lift/left", "lift/left", ""),
        ("lift/*", "elsewhere/left", "elsewhere/left"),
        ("lift/*", "lift/left/top", "lift/left/top"),
    ],
)
def test_chunks_matched_by_wildcards(expression, key, expected):
    assert matched(expression, key) == expected
