from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import yaml

from contextpolicy.bus.session import open_router
from contextpolicy.cli import main
from tests.waiting import PATIENCE

if TYPE_CHECKING:
    import zenoh

ROOT = Path(__file__).parents[2]
DEMO = str(ROOT / "timelines/demo.json")


def explain(capsys: pytest.CaptureFixture[str], policy: str, *arguments: str) -> str:
    path = str(ROOT / f"config/policies/{policy}.yaml")
    assert main(["explain", path, *arguments, "--timeline", DEMO, "--cores", "2"]) == 0
    return capsys.readouterr().out


def test_a_task_that_a_context_suspends(capsys: pytest.CaptureFixture[str]) -> None:
    assert explain(capsys, "delivery-robot", "speech", "--at", "12").splitlines()[:7] == [
        "speech gets 10m on node robot, the minimum: it is suspended.",
        "  Plan 5 has been in force for 1.9 s, caused by imu: context moving entered.",
        "  Activity `mic.level > 0.1` on mic is not in force: it is false, for `mic.level` is 0.006.",
        "  Its score is its idle score, 0.1.",
        "  Priority 10 times score 0.1 is 1.",
        "  Context moving suspends it.",
        "  So its weight is 0.",
    ]


def test_a_task_may_follow_options(capsys: pytest.CaptureFixture[str]) -> None:
    """Argparse would take POLICY alone before the first option, and call the task unrecognized."""
    ahead = explain(capsys, "delivery-robot", "speech", "--at", "12")
    assert explain(capsys, "delivery-robot", "--at", "12", "speech") == ahead


def test_one_word_more_is_refused_wherever_it_stands(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["explain", "robot", "--timeline", DEMO, "slam", "--at", "12", "speech"])
    assert "error: unrecognized arguments: speech\n" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["explain"], ["why-not"], ["simulate"]], ids=" ".join)
def test_yaml_equals_json(capsys: pytest.CaptureFixture[str], words: list[str]) -> None:
    """Straight from the planner its fields hold more than texts and numbers."""
    policy, timeline = str(ROOT / "config/policies/delivery-robot.yaml"), [DEMO]
    if words != ["simulate"]:
        timeline = ["--timeline", DEMO]
    found = {}
    for output in ("json", "yaml"):
        assert main([*words, policy, *timeline, "--cores", "2", "-o", output]) == 0
        found[output] = yaml.safe_load(capsys.readouterr().out)
    assert found["yaml"] == found["json"]


def test_redistribution(capsys: pytest.CaptureFixture[str]) -> None:
    text = explain(capsys, "delivery-robot", "slam", "--at", "12")
    assert "  Eq. 1 on node robot: 1700m * 10 / 10 = 1700m.\n" in text
    assert "  speech has 10m (suspended); the rest, divided by weight, gives it 1690m.\n" in text


def test_steps(capsys: pytest.CaptureFixture[str]) -> None:
    text = explain(capsys, "delivery-robot", "slam", "--at", "6")
    assert "  Eq. 1 on node robot: 1700m * 1 / 11 = 154.5m.\n  Rounded to steps of 10m, its share is 150m.\n" in text


def test_graph_needs_and_preconditions(capsys: pytest.CaptureFixture[str]) -> None:
    text = explain(capsys, "speech-chatbot", "--at", "6")
    assert "speech-recognition has no container of its own.\n" in text
    assert (
        "  speech-recognition is compound: it needs all of keyword-spotting, transcript; the share is theirs.\n" in text
    )
    assert "  It is a subtask of speech-recognition, whose weight is split over the subtasks that can run.\n" in text
    assert "  It needs 1000m of CPU and gets 600m: not met.\n" in text
    assert "  It needs 2000m of CPU and gets 60m: not met.\n" in text
    assert "does not hold, so it waits with weight 0: " in text


PATROL = """
apiVersion: contextpolicy.dev/v1alpha1
kind: ContextPolicy
metadata: {name: patrol, namespace: lab}
spec:
  streams:
  - {name: imu, key: robot/imu}
  - {name: mic, key: robot/microphone/level}
  tasks:
  - {name: brake, selector: {matchLabels: {app: brake}}, protected: true, activity: [{when: imu.speed > 99.0}]}
  - {name: map, selector: {matchLabels: {app: map}}, priority: 3, activity: [{when: imu.speed > 99.0}]}
  - {name: arm, selector: {matchLabels: {app: arm}}, requires: [{task: hand}], activity: [{when: imu.speed > 99.0}]}
  - {name: hand, selector: {matchLabels: {app: hand}}, activity: [{when: imu.speed > 99.0}]}
  contexts:
  - {name: moving, when: imu.speed > 0.05, exitAfter: 1s, tasks: {hand: {suspend: true}, brake: {weight: 0}}}
  - {name: halt, exitAfter: 1s, tasks: {hand: {suspend: true}, brake: {suspend: true}, map: {suspend: true}}}
  force: {context: FORCED, until: "2100-01-01T00:00:00Z"}
"""


@pytest.mark.parametrize(
    ("task", "forced", "expected"),
    [
        ("brake", "moving", "  Context moving sets its weight to 0, which has no effect: it is protected."),
        ("map", "moving", "  Nothing on node robot is active: the tasks that can run divide it by priority."),
        ("map", "moving", "  Eq. 1 on node robot: 2000m * 3 / 4 = 1500m."),
        ("arm", "moving", "  It requires task hand, which cannot run, so it waits with weight 0."),
        ("arm", "halt", "arm gets 10m on node robot, the minimum: it is suspended."),
        ("brake", "halt", "  Eq. 1 on node robot: 2000m * 1 / 1 = 2000m."),
    ],
)
def test_rest_protection_and_edges(
    task: str, forced: str, expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    policy = tmp_path / "policy.yaml"
    policy.write_text(PATROL.replace("FORCED", forced))
    assert main(["explain", str(policy), task, "--timeline", DEMO, "--cores", "2"]) == 0
    assert expected in capsys.readouterr().out.splitlines()


def test_json_is_the_structure_of_the_bus(capsys: pytest.CaptureFixture[str]) -> None:
    document = json.loads(explain(capsys, "delivery-robot", "--at", "12", "--output", "json"))
    assert document["plan"]["contexts"] == ["moving"]
    assert document["tasks"]["speech"]["effects"] == [
        {"context": "moving", "change": "suspends it", "decides": True, "ruledOut": False}
    ]
    assert document["nodes"]["robot"]["tasks"]["speech"]["share"] == 10
    assert document["streams"]["imu"]["value"]["speed"] == 0.3


def test_explain_at_zero_shows_the_first_plan(capsys: pytest.CaptureFixture[str]) -> None:
    assert "has been in force for 0 s" in explain(capsys, "speech-chatbot", "--at", "0")


def test_task_on_an_infeasible_node_has_no_share(capsys: pytest.CaptureFixture[str]) -> None:
    """It does have a container of its own: to say that it has none sends people to their selectors."""
    policy = str(ROOT / "config/policies/delivery-robot.yaml")
    assert main(["explain", policy, "--timeline", DEMO, "--at", "12", "--cores", "310m"]) == 0
    text = capsys.readouterr().out
    assert "no container of its own" not in text
    assert text.startswith("slam has no share: node robot ")


def test_an_unknown_task_is_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    policy = str(ROOT / "config/policies/delivery-robot.yaml")
    assert main(["explain", policy, "spech", "--timeline", DEMO]) == 2
    assert capsys.readouterr().err == "unknown task 'spech': expected one of slam, speech; did you mean speech?\n"


def test_timeline_and_endpoint_are_exclusive() -> None:
    with pytest.raises(SystemExit) as caught:
        main(["explain", "policy.yaml", "--timeline", DEMO, "--connect", "tcp/localhost:7447"])
    assert caught.value.code == 2


@pytest.fixture
def endpoint(free_endpoint: str, capsys: pytest.CaptureFixture[str]) -> Any:
    """A router behind which somebody explains robot/delivery-robot."""
    answer = explain(capsys, "delivery-robot", "--at", "12", "--output", "json").encode()

    def on_query(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, answer)

    with open_router([free_endpoint]) as session:
        session.declare_queryable("contextpolicy/robot/delivery-robot/explain", on_query)
        yield free_endpoint


@pytest.fixture
def _patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a machine that is busy."""
    monkeypatch.setattr("contextpolicy.commands.explain.PATIENCE", PATIENCE)


@pytest.mark.usefixtures("_patience")
def test_live(endpoint: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", "robot/delivery-robot", "speech", "--connect", endpoint]) == 0
    assert capsys.readouterr().out.startswith("speech gets 10m on node robot")


@pytest.mark.usefixtures("_patience")
def test_missing_operator_is_reported(endpoint: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", "robot/other", "--connect", endpoint]) == 2
    assert "no operator at" in capsys.readouterr().err


def test_no_router(free_endpoint: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("contextpolicy.commands.explain.PATIENCE", 0.2)
    assert main(["explain", "robot/delivery-robot", "--connect", free_endpoint]) == 2
    assert capsys.readouterr().err.startswith(f"no Zenoh router answers at {free_endpoint}: Timeout")


@pytest.mark.parametrize("command", ["explain", "why-not"])
@pytest.mark.parametrize("policy", ["policy.yaml", "config/policies/delivery-robot.yaml"])
def test_a_policy_file_without_samples(command: str, policy: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, policy]) == 2
    assert capsys.readouterr().err == f"{policy} is a file: also pass --timeline with the samples to decide on\n"


@pytest.mark.parametrize("command", [["explain", "delivery-robot"], ["why-not", "delivery-robot"], ["top"]])
@pytest.mark.parametrize("endpoint", ["banana", "", "tcp/", "tcp/a:1,b"])
def test_an_invalid_endpoint(command: list[str], endpoint: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main([*command, "--connect", endpoint])
    assert end.value.code == 2
    assert "expected an endpoint such as tcp/" in capsys.readouterr().err
