"""The demo's picture, on made-up recordings."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import pytest

from contextpolicy.explain.palette import context_colors, task_colors
from timelines.demo import picture
from timelines.demo.recorder import Recording

STARTED = 1000.0
TASKS = ("slam", "speech")


def a_plan(trigger, slam, *contexts):
    tasks = {"slam": {"share": slam}, "speech": {"share": 1 - slam}}
    return {"trigger": STARTED + trigger, "contexts": list(contexts), "tasks": tasks}


def a_recording(*plans):
    usage = {task: [(STARTED + second, 0.1 * second) for second in range(4)] for task in TASKS}
    return Recording(plans=list(plans), usage=usage, ended=STARTED + 4)


@pytest.fixture
def drawn(tmp_path):
    path = tmp_path / "demo.svg"
    picture.draw(a_recording(a_plan(-1, 0.5), a_plan(2, 0.9, "moving")), TASKS, STARTED, 4.0, path)
    return path.read_text(encoding="utf-8")


def test_a_task_has_an_area_and_a_thin_line_of_its_colour(drawn):
    for color in task_colors(TASKS).values():
        assert f"fill: {color}; fill-opacity" in drawn
        assert f"stroke: {color}; stroke-width: 1.2" in drawn
    assert f"fill: {context_colors(['moving'])['moving']}" in drawn


def test_nothing_is_dashed_or_white_and_everything_has_its_name(drawn):
    assert "dasharray" not in drawn
    assert "fill: #ffffff" not in drawn
    texts = {element.text for element in ET.fromstring(drawn).iter()}  # noqa: S314 - a picture of ours
    assert {*TASKS, "moving", "time (s)"} <= texts


def test_a_run_without_plans_is_drawn_too(tmp_path):
    picture.draw(Recording(), TASKS, STARTED, 4.0, tmp_path / "demo.svg")
    assert "slam" in (tmp_path / "demo.svg").read_text(encoding="utf-8")
