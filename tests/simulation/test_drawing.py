"""Pictures are whole whatever there is to draw."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from itertools import combinations, pairwise

import pytest

from contextpolicy.simulation.drawing import _color, draw_shares

TASKS = [f"task-{index:02d}" for index in range(24)]
FLAT = {name: [(0.0, 1 / 24)] for name in TASKS}


def root(path):
    return ET.parse(path).getroot()  # noqa: S314 - a picture of ours


def texts(path):
    return [element.text for element in root(path).iter() if element.text and element.text.strip()]


def test_24_tasks_and_8_contexts_all_have_their_name_inside_the_picture(tmp_path):
    path = tmp_path / "many.svg"
    contexts = [(f"context-{index}", index, index + 3.0) for index in range(8)]
    draw_shares(FLAT, contexts, path, until=12, weights=FLAT, title="many")
    picture = root(path)
    height = float(picture.get("height").removesuffix("pt"))
    shown = {
        element.text: float(element.get("y") or element.get("transform").split()[1].rstrip(")").split(",")[-1])
        for element in picture.iter("{http://www.w3.org/2000/svg}text")
    }
    names = [*TASKS, *(name for name, _, _ in contexts)]
    assert set(names) <= shown.keys()
    assert all(0 < shown[name] < height for name in names)
    rows = sorted(shown[name] for name in TASKS)
    assert min(below - above for above, below in pairwise(rows)) > 8, "lines of the legend overlap"


def test_24_tasks_have_24_colours():
    assert all(
        max(abs(a - b) for a, b in zip(_color(i), _color(j), strict=True)) > 0.05 for i, j in combinations(range(24), 2)
    )


def test_no_plan_at_all_is_said_in_the_picture(tmp_path):
    path = tmp_path / "none.svg"
    draw_shares({}, [], path, until=2, weights={}, title="none")
    assert "no plan" in texts(path)


@pytest.mark.parametrize("title", ["bell \x07", "half a pair \ud800", "null \x00"])
def test_a_title_of_any_characters_is_a_sound_picture(title, tmp_path):
    path = tmp_path / "x.svg"
    draw_shares(FLAT, [], path, until=0, title=title)
    assert title[:4] in " ".join(texts(path))
