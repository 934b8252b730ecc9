from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from contextpolicy.cli import main
from contextpolicy.policy.parsing import parse

ROOT = Path(__file__).parents[2]
POLICY = str(ROOT / "config/policies/delivery-robot.yaml")
EXP3 = str(ROOT / "timelines/exp3.json")


@pytest.fixture
def profiles(tmp_path):
    """A SLAM of 50 ms for each of ten pictures a second, and a speech that hardly works."""
    spread = {"slam": ("robot/camera/stereo", 0.05, 1, 0.1), "speech": ("robot/microphone", 0.004, 50, 1.0)}
    tasks = {
        name: {"deadline": deadline, "inputs": {"x": {"key": key, "depth": depth, "cpu": {"quantiles": [cpu]}}}}
        for name, (key, cpu, depth, deadline) in spread.items()
    }
    path = tmp_path / "profiles.json"
    path.write_text(json.dumps({"tasks": tasks}), encoding="utf-8")
    return str(path)


def suggest(profiles, *more):
    return main(["suggest", POLICY, EXP3, "--cores", "2", "--profiles", profiles, *more])


def test_a_patch_that_meets_the_deadlines_is_found(profiles, capsys):
    assert suggest(profiles, "--output", "json", "--tries", "12") == 0
    answer = json.loads(capsys.readouterr().out)
    misses = {
        when: answer[when]["timelines"]["exp3"]["tasks"]["slam"]["contexts"]["all"]["misses"]
        for when in ("before", "after")
    }
    assert misses["before"] > 0.05
    assert misses["after"] <= 0.01
    assert answer["patch"]
    assert answer["tries"] <= 14


def test_the_text_is_a_patch_file_that_gives_a_valid_policy(profiles, capsys):
    suggest(profiles, "--tries", "8")
    out = capsys.readouterr().out
    assert "# exp3, with the patch:" in out
    resource = yaml.safe_load(Path(POLICY).read_text(encoding="utf-8"))
    for change in yaml.safe_load(out):
        *steps, last = change["path"].strip("/").split("/")
        inner = resource
        for step in steps:
            inner = inner[int(step) if step.isdecimal() else step]
        assert (last in inner) == (change["op"] == "replace")
        inner[last] = change["value"]
    parse(resource)


def test_a_goal_that_cannot_be_met_is_told(profiles, capsys):
    assert suggest(profiles, "--tries", "1", "--deadline", "slam=10ms") == 1
    assert "slam misses more than 0.01 of its inputs all the same" in capsys.readouterr().err


def test_wrong_arguments_are_told(profiles, capsys):
    assert suggest(profiles, "--deadline", "slm=10ms", "--priority", "speach=2") == 2
    told = capsys.readouterr().err
    assert "did you mean slam" in told
    assert "did you mean speech" in told
    for wrong in (["--deadline", "slam=soon"], ["--priority", "slam=-1"], ["--misses", "2"], ["--tries", "0"]):
        with pytest.raises(SystemExit):
            suggest(profiles, *wrong)
