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
    """A SLAM of 50 ms for each of ten pictures a second, which limits slow down, and a speech that hardly works."""
    resource = yaml.safe_load(Path(POLICY).read_text(encoding="utf-8"))
    resource["spec"]["enforcement"] = {"control": "Limit"}
    (tmp_path / "policy.yaml").write_text(yaml.safe_dump(resource), encoding="utf-8")
    spread = {"slam": ("robot/camera/stereo", 0.05, 1, 0.1), "speech": ("robot/microphone", 0.004, 50, 1.0)}
    tasks = {
        name: {"deadline": deadline, "inputs": {"x": {"key": key, "depth": depth, "cpu": {"quantiles": [cpu]}}}}
        for name, (key, cpu, depth, deadline) in spread.items()
    }
    path = tmp_path / "profiles.json"
    path.write_text(json.dumps({"tasks": tasks}), encoding="utf-8")
    return str(path)


def policy_beside(profiles):
    return str(Path(profiles).with_name("policy.yaml"))


def suggest(profiles, *more):
    return main(["suggest", policy_beside(profiles), EXP3, "--cores", "2", "--profiles", profiles, *more])


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


def test_the_tables_fit_the_terminal(profiles, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    suggest(profiles, "--tries", "2")
    comments = [line for line in capsys.readouterr().out.splitlines() if line.startswith("#")]
    assert any("MISSES" in line for line in comments)
    assert [line for line in comments if len(line) > 40] == []


def test_the_text_is_a_patch_file_that_gives_a_valid_policy(profiles, capsys):
    suggest(profiles, "--tries", "8")
    out = capsys.readouterr().out
    assert "# exp3, with the patch:" in out
    resource = yaml.safe_load(Path(policy_beside(profiles)).read_text(encoding="utf-8"))
    for change in yaml.safe_load(out):
        *steps, last = change["path"].strip("/").split("/")
        inner = resource
        for step in steps:
            inner = inner[int(step) if step.isdecimal() else step]
        assert (last in inner) == (change["op"] == "replace")
        inner[last] = change["value"]
    parse(resource)


def written(path, body):
    path.write_text(body if isinstance(body, str) else json.dumps(body), encoding="utf-8")
    return str(path)


def profile(key, cpu, deadline):
    return {"deadline": deadline, "inputs": {"x": {"key": key, "depth": 2, "cpu": {"quantiles": [cpu]}}}}


@pytest.fixture
def small(tmp_path):
    """Two tasks under Limit; slam needs 0.2 cores, and has so little that it misses everything."""
    policy = {
        "apiVersion": "contextpolicy.dev/v1alpha1",
        "kind": "ContextPolicy",
        "metadata": {"name": "p", "namespace": "lab"},
        "spec": {
            "enforcement": {"control": "Limit"},
            "streams": [{"name": "imu", "key": "robot/imu"}],
            "tasks": [
                {"name": "slam", "selector": {"matchLabels": {"app": "slam"}}, "priority": 1},
                {"name": "other", "selector": {"matchLabels": {"app": "other"}}, "priority": 99},
            ],
            "contexts": [
                {
                    "name": "moving",
                    "when": "imu.value > 0.5",
                    "enterAfter": "200ms",
                    "exitAfter": "1s",
                    "tasks": {"slam": {"scale": 2}},
                }
            ],
        },
    }
    wobble = [
        {"key": "robot/imu", "encoding": "json", "at": at, "value": value} for at, value in ((0.1, 0), (3, 1), (4, 0))
    ]
    pictures = {"key": "robot/pictures", "encoding": "json", "from": 0, "to": 10, "rate": 10, "value": 1}
    timeline = {"name": "t", "duration": 10, "inputs": [*wobble, pictures]}
    paths = written(tmp_path / "p.yaml", yaml.safe_dump(policy)), written(tmp_path / "t.json", timeline)

    def suggesting(profiles, *more):
        known = written(tmp_path / "profiles.json", {"tasks": profiles})
        return main(["suggest", *paths, "--cores", "1", "--profiles", known, *more])

    return suggesting


def test_missing_profiles_are_an_error(small, capsys):
    assert small({"stranger": profile("robot/x", 0.1, 1.0)}) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert "--profiles" in said.err
    assert "slam, other" in said.err


def test_no_change_is_suggested_if_goals_are_met(small, capsys):
    assert small({"other": profile("robot/pictures", 0.01, 1.0), "slam": profile("robot/imu", 0.001, 5.0)}) == 0
    out = capsys.readouterr().out
    assert yaml.safe_load(out) == []
    assert "# every task meets its goal without a change" in out


def test_delays_are_unchanged_by_default(small, capsys):
    profiles = {"slam": profile("robot/pictures", 0.02, 0.1), "other": profile("robot/imu", 0.001, 1.0)}
    small(profiles, "--output", "json", "--tries", "60")
    changed = [change["path"] for change in json.loads(capsys.readouterr().out)["patch"]]
    assert changed
    assert [path for path in changed if "After" in path or "hold" in path] == []


def test_delays_can_be_asked_for(small, capsys):
    profiles = {"slam": profile("robot/imu", 0.001, 5.0), "other": profile("robot/pictures", 0.01, 1.0)}
    assert small(profiles, "--delays", "--output", "json") == 0
    assert json.loads(capsys.readouterr().out)["tries"] > 1


def test_suggested_min_is_the_smallest_that_suffices(small, capsys):
    profiles = {"slam": profile("robot/pictures", 0.02, 0.2), "other": profile("robot/imu", 0.001, 1.0)}
    assert small(profiles, "--output", "json", "--tries", "60") == 0
    floors = [change for change in json.loads(capsys.readouterr().out)["patch"] if change["path"].endswith("/min")]
    assert floors
    for change in floors:
        assert int(change["value"].removesuffix("m")) <= 250


def test_the_patch_carries_its_caveats(small, capsys):
    small({"slam": profile("robot/pictures", 0.02, 0.2)}, "--tries", "5")
    out = capsys.readouterr().out
    assert "# caveat: there is no profile for other: it is predicted to use no CPU" in out
    small({"slam": profile("robot/pictures", 0.02, 0.2)}, "--tries", "5", "--output", "json")
    assert (
        "there is no profile for other: it is predicted to use no CPU" in json.loads(capsys.readouterr().out)["caveats"]
    )


def test_a_goal_that_cannot_be_met_is_reported(profiles, capsys):
    assert suggest(profiles, "--tries", "1", "--deadline", "slam=10ms") == 1
    assert "slam still misses more than 0.01 of its inputs" in capsys.readouterr().err


def test_wrong_arguments_are_reported(profiles, capsys):
    assert suggest(profiles, "--deadline", "slm=10ms", "--priority", "speach=2") == 2
    reported = capsys.readouterr().err
    assert "did you mean slam" in reported
    assert "did you mean speech" in reported
    for wrong in (["--deadline", "slam=soon"], ["--priority", "slam=-1"], ["--misses", "2"], ["--tries", "0"]):
        with pytest.raises(SystemExit):
            suggest(profiles, *wrong)
