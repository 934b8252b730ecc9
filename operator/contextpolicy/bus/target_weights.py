"""Fits the weights in a plan's message into what the policy may weigh on each node. Pure."""

from __future__ import annotations

from collections import Counter, defaultdict
from typing import TYPE_CHECKING, Any

from contextpolicy.planning.allocation.enforcement import fitted, kept_weight

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from contextpolicy.policy.spec import Policy


def fit_weights(policy: Policy, targets: Sequence[dict[str, Any]], most: Mapping[str, int]) -> list[dict[str, Any]]:
    """The targets with the weights to write; on a node that `most` does not name there is none."""
    tasks = {task.name: task for task in policy.tasks}
    count = Counter((target["node"], target["task"]) for target in targets)
    found = [target if target["node"] in most else {**target, "weight": None} for target in targets]
    running: dict[str, dict[int, int]] = defaultdict(dict)
    kept: dict[str, dict[int, int]] = defaultdict(dict)
    for place, target in enumerate(found):
        node, task = target["node"], target["task"]
        if target["weight"]:
            running[node][place] = _millicores(target["weight"])
            kept[node][place] = kept_weight(tasks[task], _millicores(target["cores"]), count[node, task])
    for node, wanted in running.items():
        for place, weight in fitted(wanted, kept[node], most[node]).items():
            found[place] = {**found[place], "weight": weight / 1000}
    return found


def _millicores(cores: float) -> int:
    return round(cores * 1000)
