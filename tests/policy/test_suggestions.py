from __future__ import annotations

import pytest

from contextpolicy.policy.suggestions import did_you_mean


@pytest.mark.parametrize(
    ("name", "known", "expected"),
    [
        ("stampp", ["stamp", "frame_id"], "; did you mean stamp?"),
        ("staleafter", ["staleAfter", "key"], "; did you mean staleAfter?"),
        ("x", ["stamp"], ""),
        ("x", [], ""),
    ],
)
def test_the_nearest_known_name_is_offered_if_it_is_near(name, known, expected):
    assert did_you_mean(name, known) == expected
