"""Fits the weights in a plan's message into what the policy may weigh on each node. Pure."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

from contextpolicy.planning.allocation.enforcement import fitted, kept_weight

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from contextpolicy.policy.spec import Policy


def fit_weights(policy: Policy, targets: Sequence[dict[str, Any]], most: Mapping[str, int]) -> list[dict[str, Any]]:
    """The targets with the weights to write; none on a node that `most` does not name."""
    running: dict[str, float] = {}
    found = list(targets)
    for place, target in enumerate(found):
        node, weight = target["node"], target["weight"]
        if node not in most:
            found[place] = {**target, "weight": None}
        elif weight:
            running[node] = running.get(node, 0) + weight
    for node, cores in running.items():
        if cores * 1000 > most[node]:
            for place, amount in _fitted(policy, found, node, most[node]).items():
                found[place] = {**found[place], "weight": amount / 1000}
    return found


def _fitted(policy: Policy, targets: Sequence[dict[str, Any]], node: str, most: int) -> dict[int, int]:
    """By place among the targets, the weights of those that run on the node."""
    tasks = {task.name: task for task in policy.tasks}
    here = {place: target for place, target in enumerate(targets) if target["node"] == node}
    count = Counter([target["task"] for target in here.values()])
    running = {place: target for place, target in here.items() if target["weight"]}
    wanted = {place: _millicores(target["weight"]) for place, target in running.items()}
    kept = {
        place: kept_weight(tasks[target["task"]], _millicores(target["cores"]), count[target["task"]])
        for place, target in running.items()
    }
    return fitted(wanted, kept, most)


def _millicores(cores: float) -> int:
    return round(cores * 1000)
