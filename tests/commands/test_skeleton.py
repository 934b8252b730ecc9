from __future__ import annotations

from pathlib import Path

import pytest

from contextpolicy.cli import main
from contextpolicy.policy.quantities import parse_cpu
from contextpolicy.policy.validation.check import check
from robotkit.module import load_module

ROOT = Path(__file__).parents[2]
MODULES = sorted(str(path.parent) for path in (ROOT / "modules").glob("*/module.yaml"))

KEYWORDS = """
name: keyword-spotting
description: Spoken commands.
inputs: {audio: {key: robot/microphone, encoding: pcm-s16le-16khz-mono, depth: 50}}
outputs:
  keyword: {key: robot/speech/keyword}
  level: {key: robot/microphone/level}
needs: {cores: 1, memory: 100Mi, deadline: 1s}
"""
CHATBOT = """
name: chatbot
inputs:
  keyword: {key: robot/speech/keyword}
  imu: {key: "0/imu/dds::Imu/*", encoding: cdr, type: sensor_msgs/msg/Imu}
outputs: {answer: {key: robot/chatbot/answer}}
"""
EXPECTED = """\
# What runs on the robot: keyword-spotting, chatbot. Edit it.
apiVersion: contextpolicy.dev/v1alpha1
kind: ContextPolicy
metadata:
  name: robot
  namespace: robot
spec:
  mode: DryRun                         # only plans and reports; Enforce also acts
  # enforcement: {control: Suspend}    # the first step: contexts only suspend (default: Weight)
  streams:
  - {name: keyword_spotting, key: robot/keyword-spotting/health, producedBy: keyword-spotting}
  - {name: speech_keyword, key: robot/speech/keyword, producedBy: keyword-spotting}
  - {name: imu_dds_imu, key: "0/imu/dds::Imu/*", encoding: cdr, type: sensor_msgs/msg/Imu}
  # - {name: microphone_level, key: robot/microphone/level, producedBy: keyword-spotting}    # nothing reads it yet
  # - {name: chatbot_answer, key: robot/chatbot/answer, producedBy: chatbot}    # nothing reads it yet
  tasks:
  - name: keyword-spotting    # Spoken commands.
    selector: {matchLabels: {app: keyword-spotting}}
    priority: 1
    needs: {cores: 1, memory: 100Mi, deadline: 1s}
    # activity: [{stream: ..., when: ..., hold: 2s}]    # the samples that make it matter
  - name: chatbot
    selector: {matchLabels: {app: chatbot}}
    priority: 1
    idle: 0.1
    activity:
    - {stream: speech_keyword, hold: 2s}
    - {stream: imu_dds_imu, hold: 2s}
  contexts:
  - name: keyword-spotting-starves
    when: keyword_spotting.misses > 0.1
    enterAfter: 2s
    exitAfter: 5s
    tasks:
      keyword-spotting: {scale: 2}
"""


def files(folder: Path, *texts: str) -> list[str]:
    paths = [folder / f"{number}.yaml" for number in range(len(texts))]
    for path, text in zip(paths, texts, strict=True):
        path.write_text(text, encoding="utf-8")
    return [str(path) for path in paths]


def test_output_read_by_another_module_becomes_an_activity(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["skeleton", *files(tmp_path, KEYWORDS, CHATBOT)]) == 0
    assert capsys.readouterr().out == EXPECTED


@pytest.mark.parametrize("chosen", [MODULES, *([module] for module in MODULES)], ids=len)
def test_the_policy_of_our_own_modules_is_valid_without_a_warning(
    chosen: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["skeleton", *chosen]) == 0
    report = check([("skeleton", capsys.readouterr().out)])
    assert report.problems == []
    assert len(report.policies[0][1].tasks) == len(chosen)


@pytest.mark.parametrize(("cores", "written"), [("0.2", "200m"), ("1.5", "1500m"), ("300m", "300m"), ("2", "2")])
def test_fractional_cores_are_written_in_millicores(
    cores: str, written: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = f"name: imu\noutputs: {{reading: {{key: robot/imu}}}}\nneeds: {{cores: {cores}, deadline: 1s}}\n"
    paths = files(tmp_path, text)
    assert load_module(Path(paths[0])).needs.cores == pytest.approx(parse_cpu(written) / 1000)
    assert main(["skeleton", *paths]) == 0
    out = capsys.readouterr().out
    assert f"needs: {{cores: {written}, deadline: 1s}}" in out
    assert check([("skeleton", out)]).errors == []


def test_colliding_stream_names_are_numbered(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    imu = "name: imu\ninputs: {raw: {key: robot/imu}, in: {key: in}}\nneeds: {deadline: 1s}\n"
    assert main(["skeleton", *files(tmp_path, imu)]) == 0
    report = check([("skeleton", capsys.readouterr().out)])
    assert report.problems == []
    assert [stream.name for stream in report.policies[0][1].streams] == ["imu", "imu_2", "in_2"]


def test_all_mistakes_are_reported_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = KEYWORDS.replace("100Mi", "much").replace("key: robot/speech/keyword", "key: /x")
    assert main(["skeleton", *files(tmp_path, first, "name: Slam\nspeed: 1\n", CHATBOT, CHATBOT, "- [")]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines() == [
        f"{tmp_path}/0.yaml:",
        next(
            line for line in err.splitlines() if line.startswith("  module.outputs.keyword.key: invalid value '/x': ")
        ),
        '  module.needs.memory: invalid value \'much\': expected a memory quantity such as "100Mi" or "1Gi"',
        f"{tmp_path}/1.yaml:",
        "  module.name: invalid value 'Slam': expected at most 63 lower-case letters, digits and '-', a letter first",
        (
            "  module.speed: unknown field: expected one of the fields description, environment, inputs, name, "
            "needs, outputs; did you mean needs?"
        ),
        f"{tmp_path}/3.yaml:",
        "  module.name: invalid value 'chatbot': expected a name that is not used yet",
        f"{tmp_path}/4.yaml:",
        next(line for line in err.splitlines() if line.startswith("  not valid YAML: ")),
    ]


def test_a_file_that_is_not_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["skeleton", "nowhere"]) == 2
    assert capsys.readouterr().err == "nowhere: cannot read file: No such file or directory\n"


def test_a_name_that_kubernetes_refuses() -> None:
    with pytest.raises(SystemExit) as caught:
        main(["skeleton", MODULES[0], "--name", "My Robot"])
    assert caught.value.code == 2
