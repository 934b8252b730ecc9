"""A reader's view of the decision bus: the last plan of every policy, and how far it has been applied. Pure."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from contextpolicy.bus.decision_bus import plan_key, policy_of
from contextpolicy.policy.spec import Control, Mode, Scheduler

if TYPE_CHECKING:
    from collections.abc import Mapping

ACTING = frozenset(mode.value for mode in Mode if mode.acts)
"""The modes in which plans are carried out, as messages name them; one that we don't know is none of them."""
STAGES = {"planned": 0, "accepted": 1, "inForce": 2}
"""How far a container's limit has come, in the bus's words: decided, accepted by the API, in force on the node."""
UNREADABLE = (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError)
"""What reading a foreign message may raise."""


@dataclass(slots=True)
class ShownTarget:
    """One container of a task; `stage` says how far its new `cores` have come, if its node is `resized` at all.

    Where it is `weighted`, the API may not be involved: an agent writes weights. `uid` is its pod's: another may come
    under the same name.
    """

    task: str
    uid: str
    cores: float
    stage: str
    resized: bool
    weighted: bool

    @property
    def shown(self) -> bool:
        """Whether its stage means anything."""
        return self.resized and not (self.weighted and self.stage == "planned")


@dataclass(slots=True)
class PolicyView:
    """The last plan of one policy; `order` is (run, sequence, edition) and never goes back. `time` is Unix seconds."""

    policy: str
    order: tuple[int, int, int]
    time: float
    mode: str
    scheduler: str
    control: str
    contexts: list[str]
    cause: str
    tasks: dict[str, dict[str, Any]]
    targets: dict[str, ShownTarget]

    def stage(self, task: str) -> str | None:
        """The stage of the task's slowest container; None where the policy resizes nothing or the task has none."""
        if self.mode not in ACTING:
            return None
        stages = [target.stage for target in self.targets.values() if target.task == task and target.shown]
        return min(stages, key=STAGES.__getitem__, default=None)

    def as_json(self) -> dict[str, Any]:
        """One line of output: fields of the plan (see `planning.plan_json`), and each task's stage."""
        return {
            "policy": self.policy,
            "run": self.order[0],
            "sequence": self.order[1],
            "time": self.time,
            "mode": self.mode,
            "scheduler": self.scheduler,
            "contexts": self.contexts,
            "cause": self.cause,
            "tasks": {name: {**task, "stage": self.stage(name)} for name, task in self.tasks.items()},
        }


@dataclass(slots=True)
class BusView:
    """All policies that have published a plan."""

    policies: dict[str, PolicyView] = field(default_factory=dict)
    boards: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    """What only the operator itself knows of each policy (see `live.board`), if it answers."""

    def take_board(self, board: Mapping[str, Any]) -> None:
        """Take a policy's board; what it says of the plan counts like a message. An unreadable one is ignored.

        Without a plan (paused) none is in force: what was heard before would pass for one.
        """
        with suppress(*UNREADABLE):
            policy = str(board["policy"])
            key = plan_key(*policy.split("/"))
            self.boards[policy] = _read_board(board)
            if board["plan"] is None:
                self.policies.pop(policy, None)
            else:
                self.take(key, json.dumps(board["plan"]).encode())

    def take(self, key: str, payload: bytes | None) -> dict[str, Any] | None:
        """Take a message, None when a plan was withdrawn; returns the new state of its policy if it has changed.

        Unreadable messages are ignored: on an open bus anybody may publish.
        """
        policy, topic = policy_of(key), key.rpartition("/")[2]
        if payload is None:
            gone = topic == "plan" and self.forget(policy)
            return {"policy": policy, "withdrawn": True} if gone else None
        try:
            content = json.loads(payload)
            changed = self._plan(policy, content) if topic == "plan" else self._applied(policy, content)
        except UNREADABLE:
            return None
        return self.policies[policy].as_json() if changed else None

    def forget(self, policy: str) -> bool:
        """The policy is gone; returns whether it had a plan."""
        self.boards.pop(policy, None)
        return self.policies.pop(policy, None) is not None

    def _plan(self, policy: str, content: Mapping[str, Any]) -> bool:
        new, known = _read(policy, content), self.policies.get(policy)
        if known is not None and new.order < known.order:
            return False
        for identity, target in new.targets.items():
            before = known.targets.get(identity) if known else None
            # A republished plan must not show a container as merely planned whose limit is already in force.
            if before is not None and (before.uid, before.cores) == (target.uid, target.cores):
                target.stage = max(target.stage, before.stage, key=STAGES.__getitem__)
        self.policies[policy] = new
        return True

    def _applied(self, policy: str, step: Mapping[str, Any]) -> bool:
        known = self.policies.get(policy)
        target = known.targets.get(step["container"]) if known else None
        if known is None or target is None or STAGES[step["stage"]] <= STAGES[target.stage]:
            return False
        if known.control == Control.LIMIT and step["cores"] != target.cores:
            return False  # an intermediate limit, or one from an earlier plan
        target.stage = step["stage"]
        return True


def _read(policy: str, content: Mapping[str, Any]) -> PolicyView:
    fair = {name for name, node in content["nodes"].items() if node["scheduler"] == Scheduler.CFS}
    return PolicyView(
        policy=policy,
        order=(int(content["run"]), int(content["sequence"]), int(content.get("edition", 0))),
        time=_number(content["time"]),
        mode=str(content["mode"]),
        scheduler=str(content["scheduler"]),
        control=str(content["control"]),
        contexts=[str(context) for context in content["contexts"]],
        cause=str(content["cause"]),
        tasks={
            name: {
                "weight": _number(task["weight"]),
                "share": _number(task["share"]),
                "suspended": bool(task["suspended"]),
            }
            for name, task in content["tasks"].items()
        },
        targets={
            f"{one['namespace']}/{one['pod']}/{one['container']}": ShownTarget(
                task=str(one["task"]),
                uid=str(one["uid"]),
                cores=_number(one["cores"]),
                stage="inForce" if one["weight"] is None and one["limit"] == one["quota"] else "planned",
                resized=one["node"] in fair,
                weighted=one["weight"] is not None,
            )
            for one in content["targets"]
        },
    )


def _read_board(board: Mapping[str, Any]) -> dict[str, Any]:
    """What is shown of a board."""
    reactions = board["reactions"]
    return {
        "containers": [
            {"task": str(one["task"]), **{what: _known(one[what]) for what in ("limit", "use", "throttled")}}
            for one in board["containers"]
        ],
        "streams": {
            name: {"age": _known(one["age"]), "samples": int(one["samples"]), "silent": bool(one["silent"])}
            for name, one in board["streams"].items()
        },
        "reactions": None
        if reactions is None
        else {name: _number(reactions[name]) for name in ("count", "median", "worst", "last")},
    }


def _known(value: float | None) -> float | None:
    return None if value is None else _number(value)


def _number(value: float) -> float:
    """What a message gives for a number: float() would also read text, and JSON as Python reads it has infinities."""
    if not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"not a number: {value!r:.80}")
    return value
