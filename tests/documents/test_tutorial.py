"""The first tutorial, followed step by step: its files are saved, its commands run, and they print what it says."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import yaml

from tests.documents.commands import commands

ROOT = Path(__file__).parents[2]
FIRST = "docs/tutorials/first-policy.md"
TEXT = (ROOT / FIRST).read_text(encoding="utf-8")
PODS = ROOT / "docs" / "tutorials" / "pods.yaml"
POLICY = ROOT / "config" / "policies" / "delivery-robot.yaml"


def block(language):
    """The one block of code in this language."""
    (found,) = re.findall(rf"^```{language}\n(.*?)^```", TEXT, flags=re.MULTILINE | re.DOTALL)
    return found


def ran(command, folder):
    program = [sys.executable, "-m", *shlex.split(command)]
    path = os.environ | {"PYTHONPATH": str(ROOT / "operator"), "COLUMNS": "120"}
    done = subprocess.run(program, cwd=folder, env=path, capture_output=True, text=True, timeout=120, check=False)
    return f"{done.stdout}{done.stderr}".strip()


def sessions():
    """What is typed, in the document's order, and what it says that this prints."""
    parts = re.findall(r"^\$ (contextpolicy [^\n]*)\n((?:(?!\$ |```).*\n)*)", TEXT, flags=re.MULTILINE)
    return [(command, printed.strip()) for command, printed in parts]


def test_first_tutorial_prints_the_documented_output(tmp_path):
    (tmp_path / "first.yaml").write_text(block("yaml"))
    (tmp_path / "first.json").write_text(block("json"))
    (mistaken, finding), *rest = sessions()
    assert ran(mistaken, tmp_path) == finding
    (tmp_path / "first.yaml").write_text(block("yaml").replace("imu.sped ", "imu.speed "))
    assert [(command, ran(command, tmp_path)) for command, _ in rest] == rest
    assert "<svg" in (tmp_path / "first.svg").read_text(encoding="utf-8")
    whole = [one.text for one in commands() if one.document == FIRST and one.whole]
    assert {command for command, _ in sessions()} == {text for text in whole if text.startswith("contextpolicy")}


def test_the_timeline_has_the_fields_of_the_schema():
    assert json.loads(block("json")).keys() == {"name", "duration", "inputs"}


def test_the_second_tutorials_pods_are_those_of_its_policy():
    pods = [one for one in yaml.safe_load_all(PODS.read_text("utf-8")) if one["kind"] == "Pod"]
    policy = yaml.safe_load(POLICY.read_text("utf-8"))
    selectors = [task["selector"]["matchLabels"] for task in policy["spec"]["tasks"]]
    assert [pod["metadata"]["labels"] for pod in pods] == selectors
    assert {pod["metadata"]["namespace"] for pod in pods} == {policy["metadata"]["namespace"]}
    for pod in pods:
        (container,) = pod["spec"]["containers"]
        asked, most = container["resources"]["requests"], container["resources"]["limits"]
        assert asked["cpu"] == "10m"
        assert most["cpu"]
        assert asked["memory"] != most["memory"]
