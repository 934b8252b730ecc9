"""A new actuator is one file and its line in the wiring; its mode is a row of the table of modes: tried in a copy."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "operator/contextpolicy"

ACTUATOR = """
class Noting:
    def __init__(self):
        self.calls = []

    def recall(self, policy, stored):
        self.calls.append("recall")

    def apply(self, order):
        self.calls.append("apply")

    def release(self, policy, done):
        self.calls.append("release")
        done()

    def abandon(self, policy):
        self.calls.append("abandon")

    def observe(self, pod):
        self.calls.append("observe")

    def forget(self, uid):
        self.calls.append("forget")
"""
CHANGES = {
    "app/wiring.py": {
        "from contextpolicy.actuators.dry_run import DryRun\n": "from contextpolicy.actuators.dry_run import DryRun\n"
        "from contextpolicy.actuators.noting import Noting\n",
        "Mode.DRY_RUN: DryRun()": "Mode.DRY_RUN: DryRun(), Mode.NOTING: Noting()",
    },
    "policy/spec.py": {"    PAUSED = (": '    NOTING = ("Noting", True, True)\n    PAUSED = ('},
}
"""What a developer changes besides the new file and the value in the resource's definition."""
STORY = """
from contextpolicy.policy.spec import Mode
from tests.cluster.builders import a_pod
from tests.policies.builders import IMU, a_policy, resources
from tests.virtual_operator import VirtualOperator

robot = VirtualOperator(*(a_pod(name, {name: resources()}) for name in ("slam", "speech")))
robot.list_all()
robot.connect()
body = a_policy(mode="Noting")
robot.apply(body)
robot.sample(IMU, speed=0.3)
robot.settle()
robot.delete(body)
robot.operator.pod_gone("uid-slam")
robot.turn()
robot.operator.abandon("lab")
robot.apply(a_policy(mode="Noting"))
robot.operator.abandon("lab")
robot.turn()
print(*sorted(set(robot.operator._actuators._by_mode[Mode.NOTING].calls)))
"""
RIVALS = """
from tests.cluster.builders import a_pod
from tests.policies.builders import IMU, a_policy, resources
from tests.virtual_operator import VirtualOperator

robot = VirtualOperator(*(a_pod(name, {name: resources()}) for name in ("slam", "speech")))
robot.list_all()
robot.connect()
first, second = a_policy(mode="Noting"), a_policy(mode="Noting")
second["metadata"] |= {"name": "second", "uid": "uid-second", "creationTimestamp": "2030-01-01T00:00:00Z"}
robot.apply(first)
robot.apply(second)
robot.sample(IMU, speed=0.3)
robot.settle()
for entry in robot.operator._policies._registry.present.values():
    claim = entry.runner.claim
    print(len(claim.placement.containers), bool(claim.conflicts))
"""
"""Two policies of the new mode that select the same pods."""


def reported(tmp_path, story):
    """What a story prints where the new actuator is there."""
    copy = tmp_path / "contextpolicy"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    (copy / "actuators/noting.py").write_text(ACTUATOR)
    for file, changes in CHANGES.items():
        source = (copy / file).read_text()
        for old, new in changes.items():
            assert source.count(old) == 1
            source = source.replace(old, new)
        (copy / file).write_text(source)
    search = os.pathsep.join(str(folder) for folder in (tmp_path, ROOT, ROOT / "modules/robotkit"))
    done = subprocess.run(
        [sys.executable, "-c", story],
        env={**os.environ, "PYTHONPATH": search},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_new_actuator_is_one_file_and_one_registration(tmp_path):
    assert reported(tmp_path, STORY).split() == ["abandon", "apply", "forget", "observe", "recall", "release"]


def test_a_new_mode_that_acts_claims_its_containers_like_any_other(tmp_path):
    assert reported(tmp_path, RIVALS).splitlines() == ["2 False", "0 True"]


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_whether_a_mode_acts_is_asked_of_the_mode(path):
    """A comparison with one mode would leave out the next one that acts."""
    compared = (ast.unparse(node) for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Compare))
    allowed = {"policy.mode == Mode.ENFORCE"} if path.name == "view_tables.py" else set()
    assert [text for text in compared if "Mode.ENFORCE" in text and text not in allowed] == []
