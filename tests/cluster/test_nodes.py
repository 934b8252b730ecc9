from __future__ import annotations

import pytest

from contextpolicy.cluster.nodes import allocatable


@pytest.mark.parametrize(
    ("told", "millis"),
    [
        ("2", 2000),
        (4, 4000),
        ("1999600u", 1999),
        ("1999999999n", 1999),
        ("0", 0),
        ("2e0", 2000),
    ],
)
def test_what_a_node_has_is_rounded_down(told, millis):
    assert allocatable({"status": {"allocatable": {"cpu": told}}}) == millis


@pytest.mark.parametrize(
    "node",
    [
        *({}, {"status": None}, {"status": {"allocatable": {}}}),
        *({"status": {"allocatable": {"cpu": told}}} for told in ("many", "", "Infinity", "NaN")),
    ],
)
def test_a_node_that_is_still_joining_has_no_size(node):
    assert allocatable(node) is None
