from typing import Any

from tests.soak import oracle

POLICY = {
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


def test_a_limit_matching_a_plan_or_the_pod_is_right():
    assert not oracle.wrong(990, 300, {500, 990})
    assert not oracle.wrong(300, 300, {500, 990})
    assert not oracle.wrong(989, 300, {500, 990})
    assert not oracle.wrong(340, 500, {330})
    assert oracle.wrong(700, 300, {500, 990})
