"""A task has one colour wherever it is drawn."""

from __future__ import annotations

from itertools import combinations

from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.explain.task_colors import TASK_COLORS, task_colors

NAMES = st.lists(st.text("abcdefgh-0123", min_size=1, max_size=8), max_size=len(TASK_COLORS), unique=True)


@given(NAMES, st.randoms())
def test_colours_are_unique_and_do_not_depend_on_order(names, random):
    shuffled = random.sample(names, len(names))
    assert task_colors(names) == task_colors(shuffled)
    assert len(set(task_colors(names).values())) == len(names)


def test_a_task_keeps_its_colour_when_others_come():
    before = task_colors(["slam", "speech", "signs"])
    after = task_colors(["slam", "speech", "signs", "arm", "planner"])
    assert {name: after[name] for name in before} == before


def test_more_tasks_than_colours_share_them():
    names = [f"task-{number}" for number in range(40)]
    assert set(task_colors(names).values()) == set(TASK_COLORS)


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
