from __future__ import annotations

import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from contextpolicy.cli import main
from contextpolicy.explain.task_graph import Kind, build
from contextpolicy.policy.validation.policy_file import load_policy

POLICIES = Path(__file__).parents[2] / "config/policies"
NAMES = sorted(path.stem for path in POLICIES.glob("*.yaml") if ".expect" not in path.name)
SVG, XLINK = "{http://www.w3.org/2000/svg}", "{http://www.w3.org/1999/xlink}"
ODD = r"""
apiVersion: contextpolicy.dev/v1alpha1
kind: ContextPolicy
metadata: {name: odd}
spec:
  streams:
  - {name: imu, key: "robot/a\x01b"}
  tasks:
  - name: slam
    selector: {matchLabels: {app: slam}}
    activity:
    - when: "imu.id == \"\\\\N<b>\\\\n\"\n|| imu.x > 1"
"""
ESCAPED = {ord(character): f"#{ord(character)};" for character in '"<>'}
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


def test_complex_task_runs_while_any_subtask_can() -> None:
    graph = build(load_policy(str(POLICIES / "patrol-robot.yaml")), context="driving")
    assert [node.id for node in graph.nodes if node.suspended and node.kind is not Kind.NEED] == [
        "task-speech",
        "task-upload",
    ]
    assert [node.id for node in graph.nodes if node.kind is Kind.CONTEXT] == ["context-driving"]


def drawn(capsys: pytest.CaptureFixture[str], policy: Path | str) -> ET.Element:
    assert main(["graph", str(policy), "--output", "svg"]) == 0
    return ET.fromstring(capsys.readouterr().out.encode())  # noqa: S314 - our own output


def texts(element: ET.Element) -> list[str]:
    return ["".join(text.itertext()) for text in element.iter(f"{SVG}text")]


DEEP = """
apiVersion: contextpolicy.dev/v1alpha1
kind: ContextPolicy
metadata: {name: deep, namespace: lab}
spec:
  streams: [{name: imu, key: robot/imu}]
  tasks:
  - {name: top, subtasks: [middle]}
  - {name: middle, subtasks: [low, brake]}
  - {name: low, subtasks: [leaf]}
  - {name: leaf, selector: {matchLabels: {app: leaf}}, needs: {cores: 1, enforce: Suspend}}
  - {name: brake, selector: {matchLabels: {app: brake}}, protected: true, min: 200m}
  - {name: follower, selector: {matchLabels: {app: follower}}, requires: [{task: leaf}]}
  contexts:
  - {name: still, when: imu.still, enterAfter: 1s, tasks: {middle: {scale: 0}, brake: {suspend: true}}}
"""


@pytest.fixture
def deep(tmp_path: Path) -> str:
    path = tmp_path / "deep.yaml"
    path.write_text(DEEP)
    return str(path)


def test_a_deep_graph_with_edges_between_tasks(deep: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["graph", deep]) == 0
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert "task-middle --- task-low" in lines
    assert "task-leaf ==> task-follower" in lines
    assert 'need-leaf[/"1 core<br/>or suspended"/]:::need' in lines
    assert 'task-brake["brake<br/>priority 1, protected"]:::task' in lines
    assert 'task-leaf["leaf<br/>priority 1"]:::task' in lines
    assert main(["graph", deep, "--output", "svg"]) == 0


def test_suspended_nodes_match_the_weights(deep: str) -> None:
    graph = build(load_policy(deep), context="still")
    names = [node.id for node in graph.nodes if node.suspended and node.kind in (Kind.TASK, Kind.GROUP)]
    assert names == ["task-top", "task-middle", "task-low", "task-leaf", "task-follower"]


@pytest.mark.parametrize("name", NAMES)
def test_svg_is_xml_with_every_box(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    root = drawn(capsys, POLICIES / f"{name}.yaml")
    assert {task.name for task in load_policy(str(POLICIES / f"{name}.yaml")).tasks} <= set(texts(root))


def test_an_arrow_shows_its_condition_and_the_whole_of_a_long_one_as_its_tooltip(
    capsys: pytest.CaptureFixture[str],
) -> None:
    root = drawn(capsys, POLICIES / "patrol-robot.yaml")
    arrows = [group for group in root.iter(f"{SVG}g") if group.get("class") == "edge"]
    labels = {text: link for group in arrows for link in group.iter(f"{SVG}a") for text in texts(link)}
    assert "mic.peak > 0.6" in labels
    assert labels["people.count > 0 && people.nearest …"].get(f"{XLINK}title") == (
        "people.count > 0 && people.nearest < 3.0"
    )


def test_two_conditions_between_the_same_boxes_are_two_arrows(capsys: pytest.CaptureFixture[str]) -> None:
    root = drawn(capsys, POLICIES / "patrol-robot.yaml")
    titles = [title.text for title in root.iter(f"{SVG}title")]
    assert titles.count("stream-people->task-dialogue") == 2


def test_without_graphviz_it_says_what_to_install(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pygraphviz", None)
    assert main(["graph", CHATBOT, "--output", "svg"]) == 2
    assert capsys.readouterr().err == "drawing needs Graphviz: pip install '.[plot]' in a checkout\n"


@pytest.mark.parametrize("output", ["svg", "mermaid"])
def test_control_characters_and_markup_in_a_policy_leave_the_picture_whole(
    output: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "odd.yaml"
    file.write_text(ODD)
    assert main(["graph", str(file), "--output", output]) == 0
    out = capsys.readouterr().out
    assert not {character for character in out if not character.isprintable()} - {"\n"}
    shown = "\n".join(texts(ET.fromstring(out.encode()))) if output == "svg" else out  # noqa: S314 - our own output
    assert "robot/a�b" in shown
    condition = r'imu.id == "\\N<b>\\n" || imu.x > 1'
    assert (condition if output == "svg" else condition.translate(ESCAPED)) in shown


def test_an_unknown_context_is_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["graph", CHATBOT, "--context", "flying"]) == 2
    assert capsys.readouterr().err == "--context: unknown context 'flying': expected one of moving\n"
