"""Parse a message of the decision bus: what one policy wants of this node. Pure; trusts nothing in the message."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import msgspec

from contextpolicy.agent.cgroup_paths import is_container_id, is_uid
from contextpolicy.bus.plan_message import LARGEST_PLAN, MOST_CORES
from contextpolicy.errors import OrderError
from contextpolicy.policy.bandwidth import LONGEST, PERIOD, SHORTEST
from contextpolicy.policy.spec import Control, Mode, RealtimePolicy, Scheduler

if TYPE_CHECKING:
    from contextpolicy.cluster.agent_reports import Stamp


class OrderTarget(NamedTuple):
    """One container: its `share`, and the `limit` in force, in thousandths of a core.

    `weight` and `quota` are what to write: a weight of None is left alone, one of 0 the least; a quota of None is none.
    A quota that is `held` is restored after every foreign write, as the API can't hold it. The `container_id` is empty
    while the container is starting. The `original` is the limit that it had before any policy, None for none. The
    `pod_limit` is what its pod has as a whole (`spec.resources`), None where that is not limited; `request` what the
    kubelet has granted the container, None for nothing.
    """

    uid: str
    qos: str
    container_id: str
    share: int
    limit: int | None
    suspended: bool
    weight: int | None
    quota: int | None
    held: bool
    original: int | None
    pod_limit: int | None = None
    request: int | None = None

    def part(self, processors: int) -> int:
        """The share as a part of the period of each of the node's processors, in thousandths."""
        return self.share // processors


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
    """What one policy wants of one node; `stamp` only grows while its source lives.

    `capacity` is what the policy divides, in thousandths of a core. `drains`: suspended tasks may first
    finish the input that they are at, whatever their pods' class: under Weight.
    """

    policy: str
    stamp: Stamp
    mode: Mode
    scheduler: Scheduler
    capacity: int
    targets: tuple[OrderTarget, ...]
    manner: Manner = field(default_factory=Manner)
    drains: bool = False

    @property
    def namespace(self) -> str:
        """The policy's namespace; all its containers must be in it."""
        return self.policy.partition("/")[0]


_Count = Annotated[int, msgspec.Meta(ge=0)]
_Cores = Annotated[float, msgspec.Meta(ge=0.001, le=MOST_CORES)]
"""Cores, which messages give with at most three decimals."""
_Limit = Annotated[float, msgspec.Meta(ge=0)]
"""A pod's limit in cores: 0 means none, and more than MOST_CORES never binds."""


class _Target(msgspec.Struct, rename="camel"):
    task: str
    node: str
    uid: str
    qos: Literal["Guaranteed", "Burstable", "BestEffort"]
    container_id: str
    cores: _Cores
    weight: Annotated[float, msgspec.Meta(ge=0, le=MOST_CORES)] | None
    quota: _Limit | None
    held: bool
    original: _Limit | None
    limit: _Limit | None = None
    pod_limit: _Limit | None = None
    request: _Limit | None = None


class _Task(msgspec.Struct):
    suspended: bool


class _Node(msgspec.Struct):
    capacity: _Cores
    scheduler: Scheduler | None = None


class _Realtime(msgspec.Struct):
    period: Annotated[float, msgspec.Meta(ge=SHORTEST, le=LONGEST)]
    policy: RealtimePolicy


class _Message(msgspec.Struct):
    """What the agent needs of a plan (`planning.plan_json`); whatever else is in it is skipped."""

    policy: str
    run: _Count
    sequence: _Count
    mode: Mode
    scheduler: Scheduler
    control: Control
    realtime: _Realtime
    tasks: dict[str, _Task]
    nodes: dict[str, _Node]
    targets: list[_Target]
    edition: _Count = 0


_MESSAGE = msgspec.json.Decoder(_Message)


def read(payload: bytes, policy: str, node: str) -> NodeOrder:
    """The order in a message about `policy`; OrderError when the message is malformed or about another policy."""
    try:
        message = _MESSAGE.decode(payload[: LARGEST_PLAN + 1])
        if message.policy != policy:
            raise OrderError("WrongPolicy", f"plan of {message.policy!r:.80} on the key of {policy}")
        return _order(message, node)
    except (msgspec.DecodeError, ValueError, KeyError, RecursionError) as error:
        raise OrderError("Unreadable", f"not a valid plan: {error!r:.200}") from error


def _order(message: _Message, node: str) -> NodeOrder:
    own, tasks = message.nodes.get(node), message.tasks
    scheduler = (own and own.scheduler) or message.scheduler
    return NodeOrder(
        policy=message.policy,
        stamp=(message.run, message.sequence, message.edition),
        mode=message.mode,
        scheduler=scheduler,
        capacity=round(own.capacity * 1000) if own else 0,
        targets=tuple(_target(t, tasks[t.task]) for t in message.targets if t.node == node),
        manner=Manner(round(message.realtime.period * 1e6), message.realtime.policy),
        drains=message.control is Control.WEIGHT and scheduler is Scheduler.CFS,
    )


def _target(target: _Target, task: _Task) -> OrderTarget:
    if not is_uid(target.uid):
        raise ValueError(f"pod {target.uid!r:.80}")
    if target.container_id and not is_container_id(target.container_id):
        raise ValueError(f"container {target.container_id!r:.80}")
    return OrderTarget(
        target.uid,
        target.qos,
        target.container_id,
        round(target.cores * 1000),
        _limit(target.limit),
        task.suspended,
        None if target.weight is None else round(target.weight * 1000),
        _limit(target.quota),
        target.held,
        _limit(target.original),
        _limit(target.pod_limit),
        _limit(target.request),
    )


def _limit(cores: float | None) -> int | None:
    """In thousandths of a core; None for no limit."""
    return max(1, round(min(cores, MOST_CORES) * 1000)) if cores else None
