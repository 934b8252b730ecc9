"""The robot of the benchmark: a policy that turns with each sample, and the pods that it governs."""

from __future__ import annotations

from typing import Any

from tests.bench.hops.tree import container_id
from tests.bench.reaction import objects
from tests.cluster.builders import a_pod
from tests.policies.builders import resources

NAMESPACE = "lab"
STREAM, IMU = f"{NAMESPACE}/turn", f"{NAMESPACE}/imu"
SENT, RELAYED = "bench/sent", "bench/relayed"
"""The keys of the floor: a sample, and what stands for a plan."""


def names(limits: int) -> list[str]:
    """The tasks of a plan that moves so many limits; of two tasks only the first moves (see `objects.policy`)."""
    return [f"task-{number}" for number in range(max(2, limits))]


def policy(limits: int) -> dict[str, Any]:
    """Each sample of the one stream turns the plan, those of the other change nothing."""
    made = objects.policy(NAMESPACE, names(limits), "0")
    made["spec"]["streams"].append({"name": "imu", "key": IMU})
    made["spec"]["contexts"].append({"name": "racing", "when": "imu.speed > 5.0"})
    made["metadata"] |= {"uid": "uid-bench", "generation": 1}
    return made


def pods(limits: int) -> list[dict[str, Any]]:
    """As the API server shows them."""
    return [_pod(name) for name in names(limits)]


def _pod(name: str) -> dict[str, Any]:
    made = a_pod(name, {name: resources()})
    made["status"]["containerStatuses"][0]["containerID"] = container_id(name)
    return made
