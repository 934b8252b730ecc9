"""The picture shows what was measured, and no more."""

import json
import re
from pathlib import Path

import pytest

from tests.bench.growth.curves import draw
from tests.bench.growth.sweeps import SWEEPS

PUBLISHED = Path(__file__).parents[3] / "docs" / "measurements"
NODE = [{"limits": 8, "all_ms": 207.0}]


def a_row(size):
    stages = ("first_patch_accepted", "all_patches_accepted")
    reaction = {f"{stage}{end}": 20.0 + size for stage in stages for end in ("_ms", "_p90_ms")}
    return {"size": size, **reaction, "cpu_ms_per_plan": 9.0, "resident_mib": 95.0}


def a_result(*sweeps, node=()):
    return {**{sweep: [a_row(size) for size in SWEEPS[sweep]] for sweep in sweeps}, "node": list(node)}


def test_the_same_figures_give_the_same_picture(tmp_path):
    for name in ("one", "other"):
        draw(a_result(*SWEEPS, node=NODE), tmp_path / f"{name}.svg")
    assert (tmp_path / "one.svg").read_bytes() == (tmp_path / "other.svg").read_bytes()


@pytest.mark.parametrize(("node", "expected"), [(NODE, True), ([], False)])
def test_a_real_node_is_drawn_where_one_was_measured(tmp_path, node, expected):
    draw(a_result(*SWEEPS, node=node), tmp_path / "all.svg")
    assert ("on a real node" in (tmp_path / "all.svg").read_text()) is expected


def test_lines_are_whole_and_have_their_names_beside_them(tmp_path):
    draw(a_result(*SWEEPS, node=NODE), tmp_path / "all.svg")
    text = (tmp_path / "all.svg").read_text()
    assert "dasharray" not in text
    assert "legend" not in text
    assert text.count(">last PATCH accepted<") == len(SWEEPS)


def test_the_published_figures_can_be_drawn_again(tmp_path):
    draw(json.loads((PUBLISHED / "growth.json").read_text()), tmp_path / "growth.svg")
    drawn, published = (words(folder / "growth.svg") for folder in (tmp_path, PUBLISHED))
    assert drawn == published


def words(picture):
    """Its text: places may differ among versions of the library that draws."""
    return re.findall(r">([^<>]+)</text>", picture.read_text())


def test_sweeps_that_were_not_measured_have_no_column(tmp_path):
    draw(a_result("containers"), tmp_path / "one.svg")
    text = (tmp_path / "one.svg").read_text()
    assert "containers of one policy" in text
    assert "samples a second" not in text


def test_no_picture_is_drawn_without_measurements(tmp_path):
    draw(a_result(), tmp_path / "none.svg")
    assert not (tmp_path / "none.svg").exists()
