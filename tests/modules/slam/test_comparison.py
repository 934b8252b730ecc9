"""The command that measures SLAM and its baseline, on a few seconds of corridor."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from modules.slam import comparison, estimates
from modules.slam.comparison import main
from modules.slam.slam import State
from tests.modules.slam.test_kitti import write


def test_both_methods_are_measured_on_a_sequence(short, capsys):
    assert main([str(short), "--qualities", "0.3", "--output", "json"]) == 0
    baseline, slam = json.loads(capsys.readouterr().out)
    assert (baseline["method"], slam["method"]) == ("baseline", "slam, quality 0.3")
    for row in (baseline, slam):
        assert row["path"] == pytest.approx(1.3, abs=0.5)
        assert row["coverage"] == 1
        assert 0 <= row["drift"] < 0.05
        assert row["cpu_mean_ms"] > 0
    assert baseline["deviation"] is None
    assert 0 < slam["deviation"] < 0.05


def test_the_figures_are_a_markdown_table(tmp_path, capsys, monkeypatch):
    known = {"sequence": "short", "path": 1.26, "ate": 0.004, "drift": 0.0123, "coverage": 1.0, "degraded": 0.1}
    known |= {"cpu_mean_ms": 9.14, "cpu_median_ms": 8.0}
    rows = [known | {"method": "baseline", "deviation": None}, known | {"method": "slam", "deviation": 0.0061}]
    monkeypatch.setattr(comparison, "rows_of", lambda *_: rows)
    assert main([str(tmp_path)]) == 0
    head, line, *printed = capsys.readouterr().out.splitlines()
    assert {text.count("|") for text in (head, line, *printed)} == {10}
    assert printed == [
        "| short | baseline | 1.3 m | 0.004 m | 1.23% |  | 100% | 10% | 9.1 / 8.0 ms |",
        "| short | slam | 1.3 m | 0.004 m | 1.23% | 0.61% | 100% | 10% | 9.1 / 8.0 ms |",
    ]


@pytest.mark.parametrize("quality", ["0", "1.5", "nan", "all"])
def test_a_quality_that_there_is_not_is_refused(quality, tmp_path, capsys):
    with pytest.raises(SystemExit):
        main([str(tmp_path), "--qualities", quality])
    assert "argument --qualities" in capsys.readouterr().err


def test_a_folder_that_is_not_a_sequence_is_one_clear_line(tmp_path, capsys):
    assert main([str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "no EuRoC sequence" in line


@pytest.mark.parametrize("run", [estimates.run, estimates.run_baseline])
def test_pictures_of_another_size_count_as_broken(run, tmp_path):
    folder = write(tmp_path)
    for path in folder.glob("image_?/*.png"):
        cv2.imwrite(str(path), np.zeros((40, 200), np.uint8))
    cv2.imwrite(str(folder / "image_0/000001.png"), np.zeros((40, 180), np.uint8))
    assert run(folder).broken == 1


def test_what_can_be_measured_is_printed_beside_what_cannot(short, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(estimates, "run_baseline", lambda _: estimates.Estimate())
    assert main([str(tmp_path), str(short), "--qualities", "0.3", "--output", "json"]) == 2
    printed = capsys.readouterr()
    assert [row["method"] for row in json.loads(printed.out)] == ["slam, quality 0.3"]
    folder, method = printed.err.splitlines()
    assert "no EuRoC sequence" in folder
    assert method.startswith(f"{short.name}, baseline: 0 of 0 poses")


def test_the_deviation_is_that_of_the_last_pose_that_counts():
    estimate = estimates.Estimate()
    for state, deviation in ((State.TRACKING, 0.1), (State.DEGRADED, 0.2), (State.ADRIFT, 1000.0), (State.LOST, None)):
        estimate.add(state, 0, [0.0] * 6 + [1.0], deviation)
    assert estimate.deviation == 0.2
