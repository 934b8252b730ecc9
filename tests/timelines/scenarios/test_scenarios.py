"""Scenarios become timelines with the same story as the recordings that they name."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml

from contextpolicy.policy.key_expressions import selects
from contextpolicy.streams.timeline import load as load_timeline
from contextpolicy.streams.timeline import parse as parse_timeline
from modules.arm.joints import load_arm
from timelines.datasets.recordings import of_scenario
from timelines.scenarios.__main__ import as_text, main
from timelines.scenarios.inputs import timeline
from timelines.scenarios.scenario import FOLDER, ScenarioError, load, parse, shipped

TIMELINES = Path(__file__).parents[3] / "timelines"
MODULES = Path(__file__).parents[3] / "modules"
SCENARIOS = shipped()
SHORT = {
    "name": "short",
    "description": "one drive",
    "phases": [
        {"name": "stands", "for": 2, "says": [{"at": 0.5, "command": "stop"}], "arm": [{"at": 1, "home": True}]},
        {"name": "drives", "for": 3, "moves": True, "sees": [{"at": 1, "for": 1.5, "sign": "12"}]},
        {"name": "drives on", "for": 1, "moves": True},
    ],
}


def entries(document, key):
    return [entry for entry in parse_timeline(document).entries if entry.key == key]


@pytest.mark.parametrize(("name", "duration"), [("exp1", 180), ("exp2", 60), ("exp3", 15)])
def test_the_papers_experiments_are_as_long_as_in_the_paper(name, duration):
    assert SCENARIOS[name].duration == duration


@pytest.mark.parametrize("name", SCENARIOS)
def test_the_committed_timeline_is_what_its_scenario_gives(name):
    assert (TIMELINES / f"{name}.json").read_text(encoding="utf-8") == as_text(timeline(SCENARIOS[name]))


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_task_of_the_paper_gets_inputs(name):
    keys = {entry.key for entry in load_timeline(TIMELINES / f"{name}.json").entries}
    for task in ("slam", "signs", "speech", "imu", "navigation", "arm"):
        inputs = yaml.safe_load((MODULES / task / "module.yaml").read_text(encoding="utf-8"))["inputs"].values()
        assert all(any(selects(wanted["key"], key) for key in keys) for wanted in inputs), task


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_input_has_its_ground_truth(name):
    assert all(entry.truth is not None for entry in load_timeline(TIMELINES / f"{name}.json").entries)


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_data_set_is_a_recording_of_the_scenario(name):
    recordings = of_scenario(SCENARIOS[name])
    for entry in load_timeline(TIMELINES / f"{name}.json").entries:
        if entry.dataset:
            assert {entry.dataset, entry.dataset.partition("/")[0]} & recordings.keys()
            assert entry.dataset_rate


@pytest.mark.parametrize("name", SCENARIOS)
def test_readings_that_hold_last_the_whole_timeline_and_change_with_the_motion(name):
    document, motion = timeline(SCENARIOS[name]), SCENARIOS[name].motion
    for key in ("robot/imu", "robot/microphone/level", "robot/lidar/scan"):
        own = entries(document, key)
        assert (own[0].start, own[-1].end) == (0, SCENARIOS[name].duration)
        assert all(before.end == after.start for before, after in pairwise(own))
    for entry in entries(document, "robot/imu"):
        speed = motion.speed_at(np.linspace(entry.start, entry.end, 26)).mean()
        assert entry.value["speed"] == pytest.approx(speed, abs=0.01)
        assert entry.truth["moving"] == (entry.value["speed"] > 0)
        assert (np.linalg.norm(entry.value["gyro"]) > 0.02) == entry.truth["moving"]


def test_phases_and_events_are_placed_one_after_the_other():
    scenario = parse(SHORT)
    assert [(phase.start, phase.end, phase.moves) for phase in scenario.phases] == [
        (0, 2, False),
        (2, 5, True),
        (5, 6, True),
    ]
    assert scenario.motion.moving == ((2, 6),)
    assert [(said.at, said.keyword, said.voice) for said in scenario.script.utterances] == [(0.5, "stop", "slt")]
    assert [(plate.at, plate.until, plate.text) for plate in scenario.side_view.plates] == [(3, 4.5, "12")]


def test_the_robot_is_driven_while_it_moves_and_stopped_afterwards():
    drive, stop = entries(timeline(parse(SHORT)), "robot/navigation/order")
    assert (drive.start, drive.end, drive.value) == (2, 6, {"drive": {"forward": 0.3, "turn": 0.0}})
    assert (stop.start, stop.value) == (6, {"stop": True})


def test_a_mission_is_repeated_and_wheels_are_not_ordered():
    talks = {"name": "talks", "for": 2, "does": "talk"}
    drives = {"name": "drives", "for": 3, "moves": True, "does": "drive"}
    document = timeline(parse({"name": "short", "description": "a mission", "phases": [talks, drives]}))
    assert entries(document, "robot/navigation/order") == []
    assert [(one.start, one.end, one.rate, one.value) for one in entries(document, "robot/mission")] == [
        (0, 2, 5, {"does": "talk", "forward": 0.0}),
        (2, 5, 5, {"does": "drive", "forward": 0.3}),
    ]


def test_an_arm_that_follows_gets_orders_within_its_reach():
    phase = {"name": "grips", "for": 2, "does": "grip", "follows": 5}
    document = timeline(parse({"name": "short", "description": "a mission", "phases": [phase]}))
    orders = entries(document, "robot/arm/order")
    assert [one.start for one in orders] == pytest.approx([n / 5 + 0.1 for n in range(10)])  # none as it begins
    arm = load_arm(MODULES / "arm" / "arm.yaml")
    for one in orders:
        arm.posture_at(tuple(one.value["move"]), grip=0)
        assert one.truth == {"follows": True}


def test_the_side_camera_has_a_rate_of_its_own():
    scenario = parse({**SHORT, "side_camera": 4, "camera": 20})
    assert {entry.key: entry.dataset_rate for entry in parse_timeline(timeline(scenario)).entries if entry.dataset} == {
        "robot/camera/stereo": 20, "robot/camera/side": 4, "robot/microphone": 10, "robot/imu/raw": 200
    }  # fmt: skip
    assert scenario.side_view.rate == 4


def test_an_unknown_mission_is_refused():
    bad = {"name": "short", "description": "x", "phases": [{"name": "x", "for": 2, "does": "dance", "follows": 99}]}
    with pytest.raises(ScenarioError) as error:
        parse(bad)
    fields = [finding.field for finding in error.value.findings]
    assert fields == ["scenario.phases[0].does", "scenario.phases[0].follows"]


def test_speech_is_loud_and_wheels_are_not_silent():
    levels = [
        (e.start, e.value["level"], e.truth["speech"])
        for e in entries(timeline(parse(SHORT)), "robot/microphone/level")
    ]
    assert levels == [(0, 0.004, False), (0.5, 0.14, True), (1.7, 0.004, False), (2, 0.02, False)]


def test_a_lidar_in_the_corridor_sees_its_walls():
    first = entries(timeline(parse(SHORT)), "robot/lidar/scan")[0].value["ranges"]
    assert first[9] == pytest.approx(1.6)  # to the left
    assert first[27] == pytest.approx(1.6)  # to the right
    assert first[18] == pytest.approx(2.0)  # behind
    assert 5 < first[0] < 8  # the far wall


def test_all_mistakes_are_reported_at_once():
    bad = {
        "name": "Bad Name",
        "phases": [
            {"name": "x", "for": 2, "says": [{"at": 3, "command": "jump"}], "arm": [{"at": 0}]},
            {"name": "y", "for": -1, "sees": [{"at": 0, "for": 99, "sign": "?"}], "typo": 1},
        ],
    }
    with pytest.raises(ScenarioError) as error:
        parse(bad)
    fields = [finding.field for finding in error.value.findings]
    assert fields == [
        "scenario.name",
        "scenario.description",
        "scenario.phases[0].says[0].at",
        "scenario.phases[0].says[0].command",
        "scenario.phases[0].arm[0]",
        "scenario.phases[1].for",
        "scenario.phases[1].sees[0].sign",
        "scenario.phases[1].typo",
    ]


def test_invalid_yaml_is_reported_with_its_line(tmp_path):
    (tmp_path / "x.yaml").write_text("name: x\nphases: [", encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"x\.yaml:2:\n  not valid YAML: "):
        load(tmp_path / "x.yaml")


def test_users_can_generate_their_own_timelines(tmp_path, capsys):
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(SHORT), encoding="utf-8")
    assert main([str(tmp_path / "mine.yaml"), "--out", str(tmp_path)]) == 0
    assert load_timeline(tmp_path / "short.json").duration == 6
    assert "6 s" in capsys.readouterr().out
    assert main([str(FOLDER / "nothing.yaml")]) == 2


def test_the_file_has_a_line_for_each_input():
    text = as_text(timeline(parse(SHORT)))
    assert json.loads(text) == timeline(parse(SHORT))
    assert text.count("\n") == len(timeline(parse(SHORT))["inputs"]) + 3 + 10
