"""A task and a context have one colour each wherever they are drawn."""

from __future__ import annotations

from collections import defaultdict
from itertools import combinations
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.explain.palette import CONTEXT_COLORS, TASK_COLORS, context_colors, task_colors

ROOT = Path(__file__).parents[2]
NAMES = st.lists(st.text("abcdefgh-0123", min_size=1, max_size=8), max_size=len(CONTEXT_COLORS), unique=True)


def policies():
    for path in sorted([*ROOT.glob("config/**/*.yaml"), *ROOT.glob("timelines/**/*.yaml")]):
        for document in yaml.safe_load_all(path.read_text(encoding="utf-8")):
            if isinstance(document, dict) and document.get("kind") == "ContextPolicy":
                yield document["spec"]


@pytest.mark.parametrize("colors", [task_colors, context_colors])
@given(NAMES, st.randoms())
def test_colours_are_unique_and_do_not_depend_on_order(colors, names, random):
    shuffled = random.sample(names, len(names))
    assert colors(names) == colors(shuffled)
    assert len(set(colors(names).values())) == len(names)


@pytest.mark.parametrize(("kind", "colors"), [("tasks", task_colors), ("contexts", context_colors)])
def test_a_name_has_the_same_colour_in_every_policy_of_the_repository(kind, colors):
    seen = defaultdict(set)
    for spec in policies():
        for name, color in colors(one["name"] for one in spec.get(kind, ()) if not one.get("subtasks")).items():
            seen[name].add(color)
    assert seen
    assert {name: found for name, found in seen.items() if len(found) > 1} == {}


@pytest.mark.parametrize(("colors", "all_colors"), [(task_colors, TASK_COLORS), (context_colors, CONTEXT_COLORS)])
def test_more_names_than_colours_share_them(colors, all_colors):
    names = [f"name-{number}" for number in range(40)]
    assert set(colors(names).values()) == set(all_colors)


def test_colours_stand_out_from_each_other_and_from_both_grounds():
    for one, other in combinations(TASK_COLORS, 2):
        assert max(abs(a - b) for a, b in zip(_digits(one), _digits(other), strict=True)) >= 24, (one, other)
    for color in TASK_COLORS:
        assert _contrast(color, "#f6f8fa") >= 2, color
        assert _contrast(color, "#1c232b") >= 2, color


def _digits(color):
    return [int(color[at : at + 2], 16) for at in (1, 3, 5)]


def _contrast(one, other):
    """WCAG 2, section 1.4.3."""
    dark, light = sorted(_luminance(color) for color in (one, other))
    return (light + 0.05) / (dark + 0.05)


def _luminance(color):
    parts = [part / 255 for part in _digits(color)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return sum(weight * part for weight, part in zip((0.2126, 0.7152, 0.0722), linear, strict=True))
