"""A new actuator is one file and its line in the wiring, its mode a row and a word of the definition: in a copy."""

from __future__ import annotations

import ast

import pytest

from tests.architecture.source_code import PACKAGE
from tests.copied_sources import DEFINITION, Copy

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
NEW = "operator/contextpolicy/actuators/noting.py"
WIRING = "operator/contextpolicy/app/wiring.py"
DRY_RUN = "from contextpolicy.actuators.dry_run import DryRun\n"
IMPORT = {WIRING: (DRY_RUN, f"{DRY_RUN}from contextpolicy.actuators.noting import Noting\n")}
REGISTRATION = {WIRING: ("Mode.DRY_RUN: DryRun()", "Mode.DRY_RUN: DryRun(), Mode.NOTING: Noting()")}
MODE = {
    "operator/contextpolicy/policy/spec.py": ("    PAUSED = (", '    NOTING = ("Noting", True, True)\n    PAUSED = ('),
    DEFINITION: ("enum: [Enforce, DryRun, Paused]", "enum: [Enforce, DryRun, Paused, Noting]"),
}
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


@pytest.fixture
def copy(tmp_path):
    copy = Copy(tmp_path)
    (tmp_path / NEW).write_text(ACTUATOR, encoding="utf-8")
    copy.edit(IMPORT)
    copy.edit(REGISTRATION)
    copy.edit(MODE)
    return copy


def reported(copy, story):
    """What a story prints where the new actuator is there."""
    done = copy.python("-c", story)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_new_actuator_is_one_file_and_one_registration(copy):
    assert copy.edited() - MODE.keys() == {NEW, *REGISTRATION}
    assert reported(copy, STORY).split() == ["abandon", "apply", "forget", "observe", "recall", "release"]


def test_a_new_mode_that_acts_claims_its_containers_like_any_other(copy):
    assert reported(copy, RIVALS).splitlines() == ["2 False", "0 True"]


def test_a_new_mode_is_a_row_and_a_value_in_the_definition(copy):
    copy.make_crds()
    assert copy.failures("tests/crds/test_agreement.py", "-k", "agree_on_every_field") == ""
    copy.edit({DEFINITION: (", Noting]", "]")})
    assert "spec.mode: enum is" in copy.failures("tests/crds/test_agreement.py", "-k", "agree_on_every_field")


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_whether_a_mode_acts_is_asked_of_the_mode(path):
    """A comparison with one mode would leave out the next one that acts."""
    compared = (ast.unparse(node) for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Compare))
    allowed = {"policy.mode == Mode.ENFORCE"} if path.name == "view_tables.py" else set()
    assert [text for text in compared if "Mode.ENFORCE" in text and text not in allowed] == []
