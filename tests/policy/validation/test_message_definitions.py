"""Messages of one's own are checked where their definitions are at hand."""

from __future__ import annotations

import pytest

from contextpolicy.cli import main

POLICY = """
apiVersion: contextpolicy.dev/v1alpha1
kind: ContextPolicy
metadata: {name: robot, namespace: lab}
spec:
  streams:
  - {name: mood, key: robot/mood, encoding: cdr, type: my_msgs/msg/Mood, types: robot-types}
  tasks:
  - {name: slam, selector: {matchLabels: {app: slam}}, activity: [{stream: mood, when: mood.glad}]}
"""
CONFIG_MAP = """
apiVersion: v1
kind: ConfigMap
metadata: {name: robot-types, namespace: lab}
data:
  my_msgs.msg.Mood.msg: |
    bool glad
"""


@pytest.fixture
def validate(tmp_path, capsys):
    def run(text, *flags):
        (tmp_path / "policy.yaml").write_text(text)
        code = main(["validate", str(tmp_path / "policy.yaml"), *flags])
        out, err = capsys.readouterr()
        return code, out.replace(f"{tmp_path}/", "") + err.replace(f"{tmp_path}/", "")

    return run


@pytest.fixture
def folder(tmp_path):
    messages = tmp_path / "share/my_msgs/msg"
    messages.mkdir(parents=True)
    (messages / "Mood.msg").write_text("bool glad\n")
    return tmp_path / "share"


@pytest.mark.parametrize("text", [f"{POLICY}---{CONFIG_MAP}", f"{CONFIG_MAP}---{POLICY}"])
def test_a_config_map_in_the_files_defines_them(validate, text):
    code, reported = validate(text)
    assert code == 0
    assert "1 policy, 0 errors, 0 warnings" in reported
    code, reported = validate(text.replace("bool glad", "bool"))
    assert code == 1
    assert "spec.streams[0].types: invalid value 'robot-types': expected valid message definitions; " in reported
    assert "my_msgs.msg.Mood.msg: has a syntax error in line 1" in reported


def test_a_config_map_of_another_namespace_is_ignored(validate):
    code, reported = validate(f"{POLICY}---{CONFIG_MAP.replace('lab', 'attic')}")
    assert code == 0
    assert "ConfigMap robot-types is in none of the files, so its messages are not checked" in reported


def test_a_folder_provides_missing_definitions(validate, folder):
    assert validate(POLICY, "--types", str(folder)) == (0, "1 policy, 0 errors, 0 warnings\n")
    (folder / "my_msgs/msg/Mood.msg").rename(folder / "my_msgs/msg/Temper.msg")
    code, reported = validate(POLICY, "--types", str(folder))
    assert code == 1
    assert "invalid value 'my_msgs/msg/Mood': expected a message of ROS 2 latest or robot-types" in reported


def test_a_folder_without_definitions_is_an_error(validate, tmp_path):
    assert validate(POLICY, "--types", str(tmp_path / "nowhere"))[0] == 2
    assert "no .msg and no .idl files" in validate(POLICY, "--types", str(tmp_path))[1]
