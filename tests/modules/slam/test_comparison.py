"""The command that measures SLAM and its baseline, on a few seconds of corridor."""

from __future__ import annotations

import json
import re

import pytest

from modules.slam import estimates
from modules.slam.comparison import main


def test_both_methods_are_measured_on_a_sequence(short, capsys):
    assert main([str(short), "--qualities", "0.3", "--output", "json"]) == 0
    baseline, slam = json.loads(capsys.readouterr().out)
    assert (baseline["method"], slam["method"]) == ("baseline", "slam, quality 0.3")
    for row in (baseline, slam):
        assert row["path"] == pytest.approx(1.3, abs=0.5)
        assert row["coverage"] == 1
        assert 0 <= row["drift"] < 0.05
        assert row["cpu_mean_ms"] > 0


def test_the_figures_are_a_markdown_table(short, capsys, monkeypatch):
    monkeypatch.setattr(estimates, "run_baseline", lambda folder: estimates.run(folder, quality=0.3))
    assert main([str(short), "--qualities"]) == 0
    head, line, row = capsys.readouterr().out.splitlines()
    assert head.count("|") == line.count("|") == row.count("|") == 9
    assert re.match(
        r"\| short \| baseline \| \d\.\d m \| 0\.0\d\d m \| \d\.\d\d% \| 100% \| 0% \| [\d.]+ / [\d.]+ ms", row
    )


@pytest.mark.parametrize("quality", ["0", "1.5", "nan", "all"])
def test_a_quality_that_there_is_not_is_refused(quality, tmp_path, capsys):
    with pytest.raises(SystemExit):
        main([str(tmp_path), "--qualities", quality])
    assert "argument --qualities" in capsys.readouterr().err


def test_a_folder_that_is_not_a_sequence_is_one_clear_line(tmp_path, capsys):
    assert main([str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "no EuRoC sequence" in line
