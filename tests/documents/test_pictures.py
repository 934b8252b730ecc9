"""Pictures are legible on white and on dark pages, and have alternative text for those who do not see them."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from contextpolicy.explain.palette import CONTEXT_COLORS, MODULE_COLORS, task_colors
from contextpolicy.simulation.drawing import INK
from timelines.experiments.pictures import OTHERS
from timelines.experiments.tasks import TASKS

ROOT = Path(__file__).parents[2]
SHOWN = re.compile(r"!\[(?P<text>[^]]*)\]\([^)\s]+\.(?:svg|png)\)|<img\b[^>]*\balt=\"(?P<alt>[^\"]*)\"")


def listed(pattern: str) -> list[str]:
    command = ["git", "ls-files", pattern]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True, timeout=60).stdout.split()


@pytest.mark.parametrize("picture", listed("*.svg"))
def test_drawings_are_transparent_without_dashed_lines(picture):
    drawn = (ROOT / picture).read_text(encoding="utf-8")
    assert "fill: #ffffff" not in drawn
    assert "dasharray" not in drawn


@pytest.mark.parametrize("picture", listed("timelines/*.svg"))
def test_modules_and_contexts_have_their_colours(picture):
    """The palette's other colours are for tasks that are not in `modules/`: of the stories, the second signs' task."""
    used = set(re.findall(r"#[0-9a-f]{6}", (ROOT / picture).read_text(encoding="utf-8")))
    assert used - {*MODULE_COLORS.values(), *task_colors(TASKS).values(), *CONTEXT_COLORS, INK, OTHERS} == set()


@pytest.mark.parametrize(
    "picture", [one for one in listed("*.png") if not one.endswith("-dark.png") and "/data/" not in one]
)
def test_a_photograph_of_a_page_has_a_dark_one_beside_it(picture):
    dark = Path(picture).with_stem(f"{Path(picture).stem}-dark")
    assert (ROOT / dark).exists(), "PICTURES=1 on the node, tests/heavy/node/test_live_page_pictures.py"
    shown = [text for name in listed("*.md") if dark.name in (text := (ROOT / name).read_text(encoding="utf-8"))]
    assert shown
    assert all(f'<source media="(prefers-color-scheme: dark)" srcset="../../{dark}">' in text for text in shown)


def test_every_picture_has_an_alternative_text_that_says_what_it_shows():
    found = {
        (name, shown["text"] or shown["alt"] or "")
        for name in listed("*.md")
        for shown in SHOWN.finditer((ROOT / name).read_text(encoding="utf-8"))
    }
    assert len(found) > 15
    assert {(name, text) for name, text in found if len(text.split()) < 6} == set()
