"""Same samples in, same plans out: live on the real node and in simulation."""

import contextlib
import json
import threading
from typing import Any

import pytest
import yaml

from contextpolicy.policy.validation.policy_file import load_policy
from contextpolicy.simulation.robot import NODE, Robot
from contextpolicy.simulation.run import simulate
from contextpolicy.streams import timeline
from tests.e2e.cluster import delete, get, until
from tests.e2e.robot import policy, task
from timelines.replay.player import play

DURATION = 6.0


def imu(start, end, speed):
    value = {"gyro": [0.0, 0.0, speed], "speed": speed}
    return {"key": "e2e-robot/imu", "encoding": "json", "from": start, "to": end, "rate": 50, "value": value}


def mic(start, end, level):
    return {"key": "e2e-robot/mic", "encoding": "json", "from": start, "to": end, "rate": 10, "value": {"level": level}}


@pytest.fixture
def story(tmp_path):
    """A policy with holds, decays and delays, and a timeline on which each counts.

    Live samples come a little late, each by its own: what follows from different ones is at least 0.3 s apart.
    """
    spec = policy(
        "e2e-robot",
        streams=[{"name": "imu", "key": "e2e-robot/imu"}, {"name": "mic", "key": "e2e-robot/mic"}],
        tasks=[
            task(
                "slam", priority=10, idle=0.1, min="100m", activity=[{"when": "norm(imu.gyro) > 0.02", "hold": "800ms"}]
            ),
            task(
                "speech", priority=10, idle=0.1, activity=[{"when": "mic.level > 0.1", "hold": "300ms", "decay": "1s"}]
            ),
        ],
        contexts=[
            {
                "name": "moving",
                "when": "imu.speed > 0.05",
                "enterAfter": "200ms",
                "exitAfter": "400ms",
                "tasks": {"speech": {"suspend": True}, "slam": {"weight": 10}},
            }
        ],
    )
    inputs = [imu(0, 2, 0.0), imu(2, 4, 0.3), imu(4, 6, 0.0), mic(0, 0.5, 0.5), mic(0.5, 3, 0.0), mic(3, 6, 0.5)]
    (tmp_path / "policy.yaml").write_text(yaml.safe_dump(spec))
    (tmp_path / "story.json").write_text(json.dumps({"name": "story", "duration": DURATION, "inputs": inputs}))
    return spec, tmp_path


def decided(plan):
    shares = {name: round(entry["share"] * 1000) for name, entry in plan["tasks"].items()}
    return tuple(plan["contexts"]), shares, {name: entry["suspended"] for name, entry in plan["tasks"].items()}


def test_live_and_simulated_plans_are_identical(robot, session, story):
    spec, folder = story
    heard: list[dict[str, Any]] = []
    delete("ctxp", "robot", robot.namespace)
    robot.sensors.read(f"{robot.namespace}/imu", None)
    with session.declare_subscriber(
        f"contextpolicy/{robot.namespace}/robot/plan",
        lambda sample: _note(heard, json.loads(sample.payload.to_bytes())),
    ):
        robot.policy(**spec["spec"])
        until("the first plan is made", lambda: bool(heard) and bool(heard[-1]["nodes"]))
        before = len(heard) - 1
        play(timeline.load(folder / "story.json"), session, stop=threading.Event())
        expected = simulated(folder)
        with contextlib.suppress(AssertionError):
            until("all plans are made", lambda: len(heard) - before >= len(expected))
    assert [decided(plan) for plan in heard[before:]] == expected
    delete("ctxp", "robot", robot.namespace)


def _note(heard, plan):
    """New plans only: editions with newer weights come at a bounded rate."""
    if plan["edition"] == 0:
        heard.append(plan)


def simulated(folder):
    """What `contextpolicy simulate` decides with the node's own number of cores, two seconds past the end."""
    node = get("nodes", "contextpolicy-node", "default")["status"]["allocatable"]["cpu"]
    run = simulate(
        load_policy(str(folder / "policy.yaml")),
        timeline.load(folder / "story.json"),
        robot=Robot({NODE: round(float(node) * 1000)}),
        until=DURATION + 2,
    )
    return [
        (
            plan.contexts,
            {name: entry.share for name, entry in plan.tasks.items()},
            {name: entry.suspended for name, entry in plan.tasks.items()},
        )
        for plan in reversed({plan.sequence: plan for plan in reversed(run.plans)}.values())
    ]
