"""Pictures are complete whatever there is to draw."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from itertools import pairwise

import pytest

from contextpolicy.explain.palette import context_colors, task_colors
from contextpolicy.simulation.drawing import draw_shares

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
    assert min(below - above for above, below in pairwise(rows)) > 8, "names overlap"


def test_a_task_has_its_own_colour_in_lines_and_areas(tmp_path):
    """The same as on the live page: its name's, whatever its place."""
    path = tmp_path / "many.svg"
    draw_shares(dict(reversed(FLAT.items())), [], path, until=12, weights=FLAT)
    drawn = path.read_text(encoding="utf-8")
    colors = task_colors(TASKS).values()
    assert len(set(colors)) == len(TASKS)
    assert all(f"stroke: {color}" in drawn and f"fill: {color}" in drawn for color in colors)


def test_a_context_has_its_own_colour_whatever_its_place(tmp_path):
    path = tmp_path / "x.svg"
    draw_shares(FLAT, [("standing", 0, 1), ("moving", 1, 2)], path, until=3)
    drawn = path.read_text(encoding="utf-8")
    assert all(f"fill: {color}" in drawn for color in context_colors(["moving", "standing"]).values())


def test_lines_and_areas_have_their_names_beside_their_ends(tmp_path):
    """What changes only at the end is named where it is drawn."""
    path = tmp_path / "x.svg"
    weights = {"slam": [(0.0, 0.9), (3.0, 0.1)], "arm": [(0.0, 0.1), (3.0, 0.9)]}
    draw_shares(weights, [], path, until=3, weights=weights)
    assert [text for text in texts(path) if text in weights] == ["arm", "slam", "slam", "arm"]
    assert "legend" not in path.read_text(encoding="utf-8")


def test_a_picture_without_plans_says_so(tmp_path):
    path = tmp_path / "none.svg"
    draw_shares({}, [], path, until=2, weights={}, title="none")
    assert "no plan" in texts(path)


@pytest.mark.parametrize("title", ["bell \x07", "half a pair \ud800", "null \x00"])
def test_any_title_gives_a_valid_picture(title, tmp_path):
    path = tmp_path / "x.svg"
    draw_shares(FLAT, [], path, until=0, title=title)
    assert title[:4] in " ".join(texts(path))


def test_a_picture_is_transparent_and_has_no_dashed_lines(tmp_path):
    path = tmp_path / "x.svg"
    draw_shares(FLAT, [("moving", 1, 2)], path, until=3, weights=FLAT)
    drawn = path.read_text(encoding="utf-8")
    assert "fill: #ffffff" not in drawn
    assert "dasharray" not in drawn
    assert "time (s)" in texts(path)
