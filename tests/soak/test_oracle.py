from typing import Any

from tests.soak import oracle

POLICY: dict[str, Any] = {
    "metadata": {"name": "soak", "namespace": "lab"},
    "spec": {
        "reserve": "1",
        "streams": [{"name": "imu", "key": "lab/imu"}],
        "tasks": [{"name": name, "selector": {"matchLabels": {"app": name}}} for name in ("slam", "speech")],
        "contexts": [{"name": "moving", "when": "imu.speed > 0.05", "tasks": {"speech": {"suspend": True}}}],
    },
}
READINGS: tuple[dict[str, Any], ...] = ({}, {"imu": {"speed": 0.0}}, {"imu": {"speed": 0.3}})


def test_possible_limits_cover_all_pods_and_readings():
    assert oracle.plans(POLICY, 2, READINGS) == {"slam": {500, 990, 1000}, "speech": {10, 500, 1000}}


def test_possible_limits_cover_a_restart_in_which_tasks_remember_different_contexts():
    """slam still has the scale of its context, and speech, whose pod has just come, is not suspended by it yet."""
    effects = {"slam": {"scale": 2}, "speech": {"suspend": True}}
    moving = {"name": "moving", "when": "imu.speed > 0.05", "tasks": effects}
    policy = {**POLICY, "spec": {**POLICY["spec"], "contexts": [moving]}}
    assert oracle.plans(policy, 2, READINGS)["speech"] == {10, 330, 500, 1000}


def test_a_limit_matching_a_plan_or_the_pod_is_right():
    assert not oracle.wrong(990, 300, {500, 990})
    assert not oracle.wrong(300, 300, {500, 990})
    assert not oracle.wrong(989, 300, {500, 990})
    assert not oracle.wrong(340, 500, {330})
    assert oracle.wrong(700, 300, {500, 990})
