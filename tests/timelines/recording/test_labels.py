"""A recording of a robot becomes a timeline that satisfies the schema, and plays what was recorded."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from contextpolicy.policy.ros_types import type_store
from contextpolicy.streams.ros_message import RosMessage
from contextpolicy.streams.timeline import load
from tests.streams.test_recordings import OPEN
from timelines.recording.__main__ import main
from timelines.recording.labels import LabelError, load_labels
from timelines.recording.mcap_file import McapWriter
from timelines.replay.player import TimelineInputs

SCHEMA = Draft202012Validator(
    json.loads((Path(__file__).parents[3] / "timelines/schema.json").read_text(encoding="utf-8"))
)
DOOR = "0/door/std_msgs::msg::dds_::Bool_/TypeHashNotSupported"
PLAYED = DOOR.replace("TypeHashNotSupported", type_store().hash_rihs01("std_msgs/msg/Bool"))
LABELS = """\
name: kitchen
phases:
- {name: stands, from: 0, to: 1, truth: {moving: false}}
truth:
- {key: robot/imu, truth: {moving: true}}
- {key: robot/imu, from: 0, to: 0.5, truth: {moving: false}}
- {key: robot/microphone, truth: [{at: 0.3, keyword: left}]}
"""


@pytest.fixture
def recorded(tmp_path):
    begin = 1_795_300_000 * 10**9
    with McapWriter(tmp_path / "run.mcap") as file:
        for index in range(10):
            at = begin + index * 10**8
            heard = {"received": at, "stamp": at}
            file.heard("robot/imu", "json", json.dumps({"stamp": at, "speed": index / 10}).encode(), **heard)
            file.heard("robot/microphone", "zenoh/bytes", bytes([index]), **heard)
        file.heard(DOOR, "cdr", OPEN, received=begin, stamp=begin)
    (tmp_path / "labels.yaml").write_text(LABELS, encoding="utf-8")
    return tmp_path


def convert(folder):
    arguments = [str(folder / "run.mcap"), "--labels", str(folder / "labels.yaml")]
    return main([*arguments, "--out", str(folder), "--datasets", str(folder / "sets")])


def test_a_labelled_recording_is_a_timeline(recorded, capsys):
    assert convert(recorded) == 0
    document = json.loads((recorded / "kitchen.json").read_text(encoding="utf-8"))
    SCHEMA.validate(document)
    timeline = load(recorded / "kitchen.json")
    imu: list[Any] = [entry for entry in timeline.entries if entry.key == "robot/imu"]
    assert [(entry.start, entry.value, entry.truth["moving"]) for entry in imu[4:6]] == [
        (0.4, {"speed": 0.4}, False),
        (0.5, {"speed": 0.5}, True),
    ]
    (sound,) = [entry for entry in timeline.entries if entry.key == "robot/microphone"]
    assert sound.truth == [{"at": 0.3, "keyword": "left"}]
    assert timeline.phases[0].end == pytest.approx(0.901)
    assert "inputs, 0.901 s" in capsys.readouterr().out


def test_it_plays_what_was_recorded(recorded):
    convert(recorded)
    timed = list(TimelineInputs(load(recorded / "kitchen.json"), recorded / "sets").timed(0))
    assert [payload for _, key, payload in timed if key == "robot/microphone"] == [bytes([n]) for n in range(10)]
    (door,) = [payload for _, key, payload in timed if key == PLAYED]
    assert isinstance(door, RosMessage)
    assert door.payload(0) == OPEN


def test_all_mistakes_are_reported_at_once(tmp_path):
    path = tmp_path / "labels.yaml"
    path.write_text("name: a b\ntruth: [{key: /x, from: 2, to: 1}]\nmore: 1\n", encoding="utf-8")
    with pytest.raises(LabelError) as error:
        load_labels(path)
    assert [finding.field for finding in error.value.findings] == [
        "labels.name",
        "labels.truth[0].to",
        "labels.truth[0].key",
        "labels.truth[0].truth",
        "labels.more",
    ]


def test_missing_labels_are_reported(recorded, capsys):
    (recorded / "labels.yaml").unlink()
    assert convert(recorded) == 2
    assert "readable YAML" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([str(recorded), "--labels", "x"])
