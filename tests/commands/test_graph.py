from __future__ import annotations

from itertools import combinations
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from contextpolicy.cli import main
from contextpolicy.explain.graph_layout import place
from contextpolicy.explain.task_graph import Kind, Relation, build
from contextpolicy.policy.validation.policy_file import load_policy

POLICIES = Path(__file__).parents[2] / "config/policies"
NAMES = sorted(path.stem for path in POLICIES.glob("*.yaml") if ".expect" not in path.name)
CHATBOT = str(POLICIES / "speech-chatbot.yaml")


def test_figure_2_as_mermaid(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["graph", CHATBOT]) == 0
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert lines[3] == "flowchart LR"
    for line in (
        'stream-mic(["mic<br/>robot/microphone/level"]):::stream',
        'task-speech-recognition[["speech-recognition<br/>compound: all of"]]:::group',
        'need-keyword-spotting[/"1 core<br/>100 MiB"/]:::need',
        'stream-mic ==>|"mic.level #62; 0.1"| task-speech-recognition',
        "task-speech-recognition --- task-transcript",
        "task-transcript --> stream-text",
        "stream-imu -.-> context-moving",
        'context-moving -.->|"suspends"| task-speech-recognition',
    ):
        assert line in lines


def test_figure_4_the_graph_as_a_context_modifies_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["graph", CHATBOT, "--context", "moving"]) == 0
    suspended = [line.strip() for line in capsys.readouterr().out.splitlines() if line.endswith(":::suspended")]
    tasks = [line.partition("[")[0] for line in suspended if line.startswith("task-")]
    assert tasks == ["task-speech-recognition", "task-keyword-spotting", "task-transcript"]


def test_a_complex_task_goes_on_with_what_can_run() -> None:
    graph = build(load_policy(str(POLICIES / "patrol-robot.yaml")), context="driving")
    assert [node.id for node in graph.nodes if node.suspended and node.kind is not Kind.NEED] == [
        "task-speech",
        "task-upload",
    ]
    assert [node.id for node in graph.nodes if node.kind is Kind.CONTEXT] == ["context-driving"]


@pytest.mark.parametrize("name", NAMES)
def test_svg_is_xml_with_every_box(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["graph", str(POLICIES / f"{name}.yaml"), "--output", "svg"]) == 0
    root = ET.fromstring(capsys.readouterr().out)  # noqa: S314 - our own output
    texts = {text.text for text in root.iter("{http://www.w3.org/2000/svg}text")}
    assert {task.name for task in load_policy(str(POLICIES / f"{name}.yaml")).tasks} <= texts


@pytest.mark.parametrize("name", NAMES)
def test_boxes_do_not_overlap_and_arrows_point_right(name: str) -> None:
    layout = place(build(load_policy(str(POLICIES / f"{name}.yaml"))))
    for one, other in combinations(layout.boxes.values(), 2):
        apart = one.x + one.width <= other.x or other.x + other.width <= one.x
        assert apart or one.y + one.height <= other.y or other.y + other.height <= one.y
    for edge, points in layout.routes.items():
        if edge.relation is Relation.PRODUCES:
            assert points[0][0] < points[-1][0]


def test_an_unknown_context_is_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["graph", CHATBOT, "--context", "flying"]) == 2
    assert capsys.readouterr().err == "--context flying is not allowed: one of moving\n"
