"""The cookbook: it has every policy, and a picture of each that has expectations."""

from __future__ import annotations

from pathlib import Path

import pytest

POLICIES = Path(__file__).parents[2] / "config" / "policies"
COOKBOOK = (POLICIES / "README.md").read_text(encoding="utf-8")
EXPECTED = {path.stem for path in (POLICIES.parent / "expectations").glob("*.yaml")}


def test_every_policy_is_in_the_table():
    assert [path.name for path in POLICIES.glob("*.yaml") if f"]({path.name}) |" not in COOKBOOK] == []


def test_at_least_a_dozen_situations_are_simulated():
    assert len(EXPECTED) >= 12


@pytest.mark.parametrize("name", sorted(EXPECTED))
def test_policy_has_an_up_to_date_picture(name):
    assert f"](pictures/{name}.svg)" in COOKBOOK
    picture = (POLICIES / "pictures" / f"{name}.svg").read_text(encoding="utf-8")
    assert f"{name} on " in picture, "make pictures"
