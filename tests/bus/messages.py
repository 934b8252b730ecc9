"""Messages of the decision bus, so that a test names only what it is about."""

from __future__ import annotations

from typing import Any

KEY, APPLIED = "contextpolicy/robot/delivery/plan", "contextpolicy/robot/delivery/applied"


def plan(**changes: Any) -> dict[str, Any]:
    """While the robot moves slam has nearly everything; nothing is resized yet."""
    return {
        "policy": "robot/delivery",
        "run": 1,
        "sequence": 1,
        "edition": 0,
        "time": 100.0,
        "mode": "Enforce",
        "scheduler": "CFS",
        "control": "Limit",
        "cause": "imu: context moving entered",
        "contexts": ["moving"],
        "tasks": {
            "slam": {"score": 1.0, "weight": 10.0, "share": 0.99, "suspended": False, "because": ""},
            "speech": {"score": 1.0, "weight": 0.0, "share": 0.01, "suspended": True, "because": ""},
        },
        "nodes": {"robot-1": a_node(changes.get("scheduler", "CFS"))},
        "targets": [target("slam", 0.99), target("speech", 0.01)],
        **changes,
    }


def a_node(scheduler: str) -> dict[str, Any]:
    return {"capacity": 1.0, "scheduler": scheduler, "tasks": {"slam": 0.99, "speech": 0.01}}


def target(task: str, cores: float, limit: float | None = 0.5, **changes: Any) -> dict[str, Any]:
    return {
        "task": task,
        "node": "robot-1",
        "namespace": "robot",
        "pod": f"{task}-1",
        "uid": f"uid-{task}-1",
        "container": task,
        "cores": cores,
        "weight": None,
        "quota": cores,
        "limit": limit,
        **changes,
    }


def step(stage: str, cores: float, task: str = "slam") -> dict[str, Any]:
    """A container reached a stage."""
    identity = f"robot/{task}-1/{task}"
    return {"run": 1, "sequence": 1, "stage": stage, "container": identity, "cores": cores, "time": 100.1}


BOARD: dict[str, Any] = {
    "policy": "robot/delivery",
    "plan": plan(),
    "containers": [{"task": "slam", "limit": 0.99, "use": 0.5, "throttled": 0.25}],
    "streams": {
        "imu": {"age": 0.25, "samples": 7, "silent": False},
        "mic": {"age": None, "samples": 0, "silent": True},
    },
    "reactions": {"count": 3, "median": 0.02, "worst": 0.1, "last": 0.03},
}
"""What the operator answers about a policy."""
