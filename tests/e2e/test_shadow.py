"""A changed policy beside the old one: shown, promoted, reverted automatically, and adopted."""

from __future__ import annotations

import json

import pytest

from contextpolicy.cli import main
from tests.e2e.cluster import apply, get, run, until
from tests.e2e.robot import policy

NAMESPACE = "e2e-robot"
SHADOW = "robot-next"
GENTLE = [{"name": "moving", "when": "imu.speed > 0.05", "tasks": {"slam": {"weight": 7}, "speech": {"weight": 3}}}]
BEFORE, AFTER = {"slam": 990, "speech": 10}, {"slam": 700, "speech": 300}


def a_shadow(**changes):
    """Speech keeps some while the robot moves."""
    shadow = {"of": "robot", "health": f"{NAMESPACE}/*/health", "patience": "2s"}
    return policy(NAMESPACE, SHADOW, **{"mode": "DryRun", "shadow": shadow, "contexts": GENTLE, **changes})


@pytest.fixture
def beside(governed):
    """A robot that drives and misses next to nothing, with the shadow of its policy."""
    governed.drive(0.3)
    governed.expect(**BEFORE)
    misses(governed, 0.01)
    apply(a_shadow())
    until("the shadow decides", lambda: bool(shadow(governed).get("difference")))
    yield governed
    governed.sensors.read(f"{NAMESPACE}/slam/health", None)


def misses(robot, part):
    """What slam's module says of itself from now on."""
    robot.sensors.read(f"{NAMESPACE}/slam/health", {"misses": part, "suspended": False})


def shadow(robot):
    return robot.status(SHADOW).get("shadow") or {}


def known(robot):
    """The shadow has seen enough of how the tasks fare under the other policy."""
    return any("missesBefore" in task for task in shadow(robot).get("tasks", ())) or shadow(robot)


def test_dry_run_moves_nothing_and_reports_what_it_would(beside, capsys):
    assert shadow(beside)["difference"] == "slam 990m -> 700m, speech 10m -> 300m"
    assert beside.condition("Ready", SHADOW)[0] == "True"
    beside.expect(**BEFORE)
    assert main(["shadow", f"{NAMESPACE}/{SHADOW}", "--output", "json"]) == 0
    reported = json.loads(capsys.readouterr().out)
    assert reported["stretches"][-1]["shares"] == {"slam": [0.99, 0.7], "speech": [0.01, 0.3]}


def test_promotion_is_reverted_when_misses_rise(beside):
    until("the misses before are known", lambda: known(beside), patience=60)
    assert main(["promote", f"{NAMESPACE}/{SHADOW}"]) == 0
    beside.expect(**AFTER)
    until("the status says so", lambda: beside.status().get("promotedShadow") == SHADOW or beside.status())
    misses(beside, 0.9)
    beside.expect(**BEFORE)
    until("its status says so", lambda: beside.condition("Applied", SHADOW)[0] == "False" or beside.status(SHADOW))
    assert "slam has missed" in beside.condition("Applied", SHADOW)[1]
    assert [len(beside.reported("Reverted", name)) for name in ("robot", SHADOW)] == [1, 1]
    assert beside.condition("Ready")[0] == "True"


def test_a_new_operator_continues_with_what_was_promoted(beside, operator):
    until("the misses before are known", lambda: known(beside), patience=60)
    assert main(["promote", f"{NAMESPACE}/{SHADOW}"]) == 0
    beside.expect(**AFTER)
    until("the status says so", lambda: beside.status().get("promotedShadow") == SHADOW or beside.status())
    run("kubectl", "rollout", "restart", "deployment/e2e", "-n", operator)
    run("kubectl", "rollout", "status", "deployment/e2e", "-n", operator, "--timeout=120s", timeout=130)
    beside.expect(**AFTER)


def test_promoted_shadow_is_adopted(beside):
    assert main(["promote", f"{NAMESPACE}/{SHADOW}"]) == 0
    beside.expect(**AFTER)
    until("the status says so", lambda: beside.status().get("promotedShadow") == SHADOW or beside.status())
    assert main(["adopt", f"{NAMESPACE}/{SHADOW}"]) == 0
    until("the shadow is gone", lambda: SHADOW not in run("kubectl", "get", "ctxp", "-n", NAMESPACE, "-o", "name"))
    beside.expect(**AFTER)
    spec = get("ctxp", "robot", NAMESPACE)["spec"]
    assert (spec["contexts"], "shadow" in spec, spec["mode"]) == (GENTLE, False, "Enforce")
