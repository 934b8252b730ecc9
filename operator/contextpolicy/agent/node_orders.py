"""Parse a message of the decision bus: what one policy wants of this node. Pure; trusts nothing in the message."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from contextpolicy.agent.cgroup_paths import is_container_id, is_uid
from contextpolicy.errors import OrderError
from contextpolicy.policy.bandwidth import LONGEST, PERIOD, SHORTEST
from contextpolicy.policy.spec import Control, Mode, RealtimePolicy, Scheduler

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.cluster.agent_reports import Stamp

QOS_CLASSES = ("Guaranteed", "Burstable", "BestEffort")
MAX_BYTES = 1 << 20
MAX_CORES = 1024


@dataclass(frozen=True, slots=True)
class OrderTarget:
    """One container: `share` in thousandths of a core (or of the realtime period), `limit` the one in force.

    The `container_id` is empty while the container is starting.
    """

    uid: str
    qos: str
    container_id: str
    share: int
    limit: int | None
    suspended: bool


@dataclass(frozen=True, slots=True)
class Manner:
    """How a policy's tasks run in realtime: the period of budgets in microseconds, and the scheduling policy.

    The kernel's default period is a second: a task with a tenth of it stands still for 0.9 s at a time, and everything
    else may have to wait for 0.95 s. Both are enough to lose a Zenoh session.
    """

    period: int = round(PERIOD * 1e6)
    policy: RealtimePolicy = RealtimePolicy.RR


@dataclass(frozen=True, slots=True)
class NodeOrder:
    """What one policy wants of one node; `stamp` only grows while its source lives."""

    policy: str
    stamp: Stamp
    mode: Mode
    scheduler: Scheduler
    control: Control
    capacity: int
    targets: tuple[OrderTarget, ...]
    manner: Manner = field(default_factory=Manner)

    @property
    def namespace(self) -> str:
        """The policy's namespace; all its containers must be in it."""
        return self.policy.partition("/")[0]


def read(payload: bytes, policy: str, node: str) -> NodeOrder:
    """The order in a message about `policy`; OrderError when the message is malformed or about another policy."""
    try:
        document = json.loads(payload[: MAX_BYTES + 1])
        if document["policy"] != policy:
            raise OrderError("WrongPolicy", f"a message of {document['policy']!r:.80} on the key of {policy}")
        return _order(document, node)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError, OverflowError) as error:
        raise OrderError("Unreadable", f"not a plan: {error!r:.200}") from error


def _order(document: Mapping[str, Any], node: str) -> NodeOrder:
    own = document["nodes"].get(node, {})
    tasks = document["tasks"]
    return NodeOrder(
        policy=document["policy"],
        stamp=(_count(document["run"]), _count(document["sequence"]), _count(document.get("edition", 0))),
        mode=Mode(document["mode"]),
        scheduler=Scheduler(own.get("scheduler", document["scheduler"])),
        control=Control(document["control"]),
        capacity=_thousandths(own["capacity"]) if own else 0,
        targets=tuple(_target(t, tasks[t["task"]]) for t in document["targets"] if t["node"] == node),
        manner=_manner(document["realtime"]),
    )


def _target(target: Mapping[str, Any], task: Mapping[str, Any]) -> OrderTarget:
    if not is_uid(target["uid"]) or target["qos"] not in QOS_CLASSES:
        raise ValueError(f"pod {target['uid']!r:.80} of class {target['qos']!r:.20}")
    if target["containerId"] != "" and not is_container_id(target["containerId"]):
        raise ValueError(f"container {target['containerId']!r:.80}")
    return OrderTarget(
        uid=target["uid"],
        qos=target["qos"],
        container_id=target["containerId"],
        share=_thousandths(target["cores"]),
        limit=None if target.get("limit") is None else _thousandths(target["limit"]),
        suspended=task["suspended"] is True,
    )


def _manner(realtime: Mapping[str, Any]) -> Manner:
    return Manner(_period(realtime["period"]), RealtimePolicy(realtime["policy"]))


def _period(seconds: object) -> int:
    if not isinstance(seconds, int | float) or not SHORTEST <= seconds <= LONGEST:
        raise ValueError(f"{seconds!r:.80} is no period from {SHORTEST} to {LONGEST} s")
    return round(seconds * 1e6)


def _count(number: object) -> int:
    if type(number) is not int or number < 0:
        raise ValueError(f"{number!r:.80} is no whole number from 0")
    return number


def _thousandths(cores: object) -> int:
    """Cores, which messages give with at most three decimals, in thousandths; ValueError when out of range."""
    if not isinstance(cores, int | float) or not 0.001 <= cores <= MAX_CORES:
        raise ValueError(f"{cores!r:.80} is no number of cores from 0.001 to {MAX_CORES}")
    return round(cores * 1000)
