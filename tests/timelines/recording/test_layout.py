"""The layout for Foxglove: every path that its panels ask for is in a recording, and in what looks on."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from pathlib import Path
from typing import Any

import foxglove
from mcap.reader import make_reader

from contextpolicy.bus.decision_bus import plan_key
from contextpolicy.explain.palette import task_colors
from contextpolicy.planning.plan_json import plan_json
from contextpolicy.policy.validation.policy_file import load_policy
from contextpolicy.simulation.robot import NODE, Robot
from contextpolicy.simulation.run import simulate
from contextpolicy.streams.timeline import load
from robotkit.health import Health, Queue, Snapshot
from timelines.recording import layout
from timelines.recording.live import LiveChannels
from timelines.recording.mcap_file import McapWriter
from timelines.recording.recorder import BusRecorder

ROOT = Path(__file__).parents[3]
POLICY = ROOT / "config" / "policies" / "whole-robot.yaml"
LAYOUT = ROOT / "timelines" / "recording" / "foxglove.json"
ROBOT = load_policy(str(POLICY))


def panels(content):
    if content["type"] == "panel":
        return [content]
    return [panel for item in content["items"] for panel in panels(item["content"])]


def asked():
    """All message paths, without what is computed from them."""
    shown = panels(json.loads(LAYOUT.read_text(encoding="utf-8"))["content"])
    paths = [one["value"] for panel in shown for one in panel["config"].get("paths", ())]
    paths += [value for p in shown for name, value in p["config"].items() if name in ("topicPath", "topicToRender")]
    return [one.partition(".@")[0] for one in paths]


def split(path):
    """The topic and the fields of a message path."""
    return [quoted or plain for quoted, plain in re.findall(r'"([^"]*)"|([^.]+)', path)]


def find(message, fields):
    for field in fields:
        message = message[field]
    return message


def test_a_task_has_the_live_pages_colour_in_every_plot():
    shown = panels(json.loads(LAYOUT.read_text(encoding="utf-8"))["content"])
    drawn = [path for panel in shown for path in panel["config"].get("paths", ()) if "color" in path]
    colors = task_colors(leaf.name for leaf in ROBOT.leaves)
    assert {path["label"] for path in drawn} == colors.keys()
    assert all(path["color"] == colors[path["label"]] for path in drawn)


def reported():
    """What the robot's bus says in ten seconds: plans as the operator makes them, health as robotkit reports it."""
    for plan in simulate(ROBOT, load(ROOT / "timelines" / "exp2.json"), robot=Robot({NODE: 2000}), until=10.0).plans:
        yield plan_key("robot", "whole-robot"), json.dumps({**plan_json(ROBOT, plan), "targets": []}).encode()
    for task in ROBOT.leaves:
        health = Health(Snapshot(0, 0)).message(Snapshot(10**9, 0, done=9), Queue(), suspended=False)
        yield f"robot/{task.name}/health", json.dumps(health).encode()


def record(sink, cgroup):
    """As the recorder does it, but for the bus."""
    nowhere: Any = None
    recorder = BusRecorder(nowhere, sink, {task.name: cgroup for task in ROBOT.leaves})
    for key, payload in reported():
        sink.heard(key, "json", payload, received=1, stamp=1)
    recorder._count()


def test_the_committed_layout_matches_the_sample_policy(capsys):
    assert layout.main([str(POLICY)]) == 0
    assert capsys.readouterr().out == LAYOUT.read_text(encoding="utf-8"), (
        f"python -m timelines.recording.layout {POLICY}"
    )


def test_every_path_of_the_layout_is_in_a_recording(tmp_path, cgroup):
    file = tmp_path / "run.mcap"
    with McapWriter(file) as writer:
        record(writer, cgroup)
    recorded = defaultdict(list)
    with file.open("rb") as opened:
        for _, channel, message in make_reader(opened).iter_messages():
            recorded[channel.topic].append(json.loads(message.data))
    assert len(asked()) > 20
    for topic, *fields in map(split, asked()):
        assert find(recorded[topic][-1], fields) is not None, (topic, fields)


def test_it_shows_every_task_and_each_figure_of_the_live_page():
    titles = [panel["title"] for panel in panels(json.loads(LAYOUT.read_text(encoding="utf-8"))["content"])]
    assert titles[:3] == ["Contexts", "Weights, normalised (Figure 5)", "Shares in cores (Figure 7)"]
    assert {split(path)[2] for path in asked() if path.endswith(".share")} == {task.name for task in ROBOT.leaves}


def decided(file):
    """The messages, without those of the cgroups."""
    with file.open("rb") as opened:
        for schema, channel, message in make_reader(opened).iter_messages():
            assert schema is not None
            if not channel.topic.startswith("cgroup/"):
                yield channel.topic, schema.name, message.data


def test_a_live_viewer_receives_what_a_recording_contains(tmp_path, cgroup):
    """Channels of Foxglove's own library, written to a file instead of a WebSocket."""
    context = foxglove.Context()
    with foxglove.open_mcap(tmp_path / "live.mcap", context=context):
        record(LiveChannels(context), cgroup)
    with McapWriter(tmp_path / "run.mcap") as writer:
        record(writer, cgroup)
    assert sorted(decided(tmp_path / "live.mcap")) == sorted(decided(tmp_path / "run.mcap"))


def test_an_invalid_policy_is_refused(tmp_path, capsys):
    (tmp_path / "policy.yaml").write_text("kind: ContextPolicy")
    assert layout.main([str(tmp_path / "policy.yaml")]) == 2
    assert "policy.yaml" in capsys.readouterr().err
