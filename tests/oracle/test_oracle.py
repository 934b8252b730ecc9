"""A thousand random policies decide as the reference model says; `python -m tests.oracle` tries any others."""

from __future__ import annotations

import pytest

from tests.oracle.comparison import difference
from tests.oracle.generator import a_story

POLICIES = 1000
AT_ONCE = 50


@pytest.mark.parametrize("first", range(0, POLICIES, AT_ONCE))
def test_the_planner_decides_as_the_model_says(first):
    found = {seed: difference(a_story(seed)) for seed in range(first, first + AT_ONCE)}
    assert {seed: words for seed, words in found.items() if words} == {}
