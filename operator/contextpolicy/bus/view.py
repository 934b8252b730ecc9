"""The decision bus for a human reader: the last plan of every policy, and how far it has been applied. Pure."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from rich.console import Group
from rich.table import Table
from rich.text import Text

from contextpolicy.bus.decision_bus import plan_key, policy_of
from contextpolicy.policy.spec import Control, Mode, Scheduler

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

STAGES = {"planned": 0, "accepted": 1, "inForce": 2}
"""How far a container's limit has come, in the bus's words: decided, accepted by the API, in force on the node."""
UNREADABLE = (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError)
"""What a message of somebody else may raise where it is read."""
WORDS = {"planned": "planned", "accepted": "accepted", "inForce": "in force"}


@dataclass(slots=True)
class ShownTarget:
    """One container of a task; `stage` says how far its new `cores` have come, if its node is `resized` at all.

    Where it is `weighted`, the API may hear nothing: an agent writes weights.
    """

    task: str
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
        if self.mode != Mode.ENFORCE:
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
    """What only the operator itself can tell of each policy (see `live.board`), if it was asked."""

    def take_board(self, board: Mapping[str, Any]) -> None:
        """Take a policy's board; what it says of the plan counts like a message. An unreadable one is ignored."""
        with suppress(*UNREADABLE):
            policy = str(board["policy"])
            key = plan_key(*policy.split("/"))
            self.boards[policy] = _read_board(board)
            if board["plan"] is not None:
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
            if before is not None and before.cores == target.cores:
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


def live(view: BusView, now: float) -> Group | Text:
    """A table for each policy."""
    if not view.policies:
        return Text("no plans yet")
    policies = [policy for _, policy in sorted(view.policies.items())]
    return Group(*(part for policy in policies for part in _parts(policy, view.boards.get(policy.policy), now)))


def _parts(policy: PolicyView, board: Mapping[str, Any] | None, now: float) -> Iterator[Text | Table]:
    yield _headline(policy, now)
    yield _tasks(policy, board["containers"] if board else ())
    if board is not None:
        if board["streams"]:
            yield _streams(board["streams"])
        yield _reactions(board["reactions"])


def _headline(policy: PolicyView, now: float) -> Text:
    """A line above the table: a title would wrap at its width. `Text`, because a cause may contain [brackets]."""
    mode = "" if policy.mode == Mode.ENFORCE else f"   {policy.mode}"
    contexts = ", ".join(policy.contexts) or "-"
    age = max(0.0, now - policy.time)
    return Text(f"{policy.policy}{mode}   context: {contexts}   for {age:.0f} s: {policy.cause}", style="bold")


def _tasks(policy: PolicyView, containers: Sequence[Mapping[str, Any]]) -> Table:
    headings = ("task", "weight", "share", "limit", "use", "throttled", "stage")
    table = titled("", headings, left=("task", "stage"))
    for name, task in policy.tasks.items():
        own = [container for container in containers if container["task"] == name]
        stage = WORDS.get(policy.stage(name) or "", "-")
        suspended = "   suspended" if task["suspended"] else ""
        parts = [part for one in own if (part := one["throttled"]) is not None]
        table.add_row(
            Text(name),
            f"{task['weight']:g}",
            cores(task["share"]),
            cores(_sum(one["limit"] for one in own)),
            cores(_sum(one["use"] for one in own)),
            f"{max(parts):.0%}" if parts else "-",
            stage + suspended,
        )
    return table


def _sum(amounts: Iterable[float | None]) -> float | None:
    known = [amount for amount in amounts if amount is not None]
    return sum(known) if known else None


def _streams(streams: Mapping[str, Mapping[str, Any]]) -> Table:
    table = titled("", ("stream", "age", "samples", "state"), left=("stream", "state"))
    for name, stream in streams.items():
        age = "-" if stream["age"] is None else f"{stream['age']:.1f} s"
        state = "silent" if stream["silent"] else "not heard yet" if stream["age"] is None else "heard"
        table.add_row(Text(name), age, str(stream["samples"]), state)
    return table


def _reactions(reactions: Mapping[str, float] | None) -> Text:
    if reactions is None:
        return Text("no reaction to a sample yet")
    told = (f"{name} {reactions[name] * 1000:.0f} ms" for name in ("median", "worst", "last"))
    return Text(f"sample to limit in force: {', '.join(told)} of the latest {reactions['count']:.0f}")


def titled(title: str, headings: Sequence[str], *, left: Sequence[str]) -> Table:
    """An empty table; the columns named in `left` hold text, the others right-aligned numbers."""
    table = Table(title=Text(title) if title else None, title_justify="left")
    for heading in headings:
        table.add_column(heading, justify="left" if heading in left else "right")
    return table


def cores(value: float | None) -> str:
    """Cores as Kubernetes' thousandths, such as 150m; a dash for None."""
    return "-" if value is None else f"{value * 1000:.0f}m"
