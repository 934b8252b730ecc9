"""What containers had before any policy: kept in the policies' status, which only the operator may write. Pure.

Level-triggered: `note` and `drop` change what a status should hold, `changes` is the difference to what it holds. A
container is resized only after its original is stored, so a restarted operator always knows how to put it back.
"""

from __future__ import annotations

import logging
from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from contextpolicy.cluster.pods import Cpu, millicores
from contextpolicy.policy.quantities import format_cpu

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

log = logging.getLogger(__name__)

FIELD = "originals"
"""Field of the status: pod UID -> the pod's name and its containers' CPU resources."""


@dataclass(frozen=True, slots=True)
class Original:
    """What a container had before `policy` first resized it."""

    policy: str
    cpu: Cpu


_NONE: Mapping[str, Original] = {}


class Originals:
    """The originals of all policies. One policy keeps each; it moves when another policy takes the container over."""

    def __init__(self) -> None:
        self._known: dict[str, dict[str, Original]] = defaultdict(dict)
        self._pod_names: dict[str, str] = {}
        self._records: dict[str, _Record] = {}

    def recall(self, policy: str, stored: object, exists: Callable[[str], bool]) -> None:
        """Load what a policy's status holds, once, when the policy first appears; pods that are gone are left out.

        Two policies may hold the same container if the operator was killed during a takeover. Both then hold the same
        value, so either may keep it.
        """
        if policy in self._records:
            return
        record = self._record(policy)
        record.stored = dict(read(policy, stored))
        record.doubtful = {uid: set() for uid in stored if uid not in record.stored} if isinstance(stored, dict) else {}
        record.dirty = bool(stored)
        for uid, (pod_name, containers) in record.stored.items():
            for name, cpu in containers.items() if exists(uid) else ():
                self._keep(policy, uid, pod_name, name, cpu)

    def forget(self, policy: str) -> None:
        """The policy is gone, and its status with it."""
        for uid, name in list(self.of(policy)):
            self.drop(uid, name)
        self._records.pop(policy, None)

    def at(self, uid: str, name: str) -> Original | None:
        """A container's original."""
        return self._known.get(uid, _NONE).get(name)

    def in_pod(self, uid: str) -> Mapping[str, Original]:
        """A pod's originals by container."""
        return self._known.get(uid, _NONE)

    def cpu(self, uid: str, name: str) -> Cpu | None:
        """What a container had before any policy, if one moved it."""
        original = self.at(uid, name)
        return original.cpu if original else None

    def of(self, policy: str) -> Iterable[tuple[str, str]]:
        """Pod UID and container name of every original that the policy keeps."""
        return self._records[policy].wanted if policy in self._records else ()

    def note(self, policy: str, uid: str, pod_name: str, name: str, cpu: Cpu) -> None:
        """The policy is about to resize the container. If another policy did so before, that one's original is kept."""
        known = self.at(uid, name)
        if known is None or known.policy != policy:
            self._keep(policy, uid, pod_name, name, known.cpu if known else cpu)

    def drop(self, uid: str, name: str) -> None:
        """The container is restored, or gone: its original is not needed any more."""
        known = self._known[uid].pop(name, None)
        if known is not None:
            record = self._records[known.policy]
            record.wanted.discard((uid, name))
            record.dirty = True
        if not self._known[uid]:
            del self._known[uid]
            self._pod_names.pop(uid, None)

    def drop_pod(self, uid: str) -> None:
        """The pod is gone."""
        for name in list(self.in_pod(uid)):
            self.drop(uid, name)

    def is_stored(self, policy: str, uid: str, name: str) -> bool:
        """Whether the status holds the original, so that the operator would know it after a restart."""
        known = self._known.get(uid, _NONE).get(name)
        return known is not None and known.policy == policy and self._records[policy].holds(uid, name, known.cpu)

    def changes(self, policy: str) -> dict[str, Any]:
        """The merge patch that `status.originals` needs; empty when it needs none, or while one is under way."""
        record = self._records.get(policy)
        if record is None or record.sent is not None or not record.dirty:
            return {}
        found = record.changes(self._wanted(record))
        record.dirty = bool(found)
        return found

    def send(self, policy: str) -> None:
        """The patch from `changes` has been sent."""
        record = self._records[policy]
        record.sent, record.dirty = self._wanted(record), False

    def succeed(self, policy: str) -> None:
        """What was sent is stored; policies that handed some of it over may now remove it."""
        record = self._records.get(policy)
        if record is not None and record.sent is not None:
            record.stored, record.doubtful, record.sent = record.sent, {}, None
            for other in self._records.values():
                other.dirty |= bool(other.handed_over)

    def fail(self, policy: str) -> None:
        """The write failed: the status may hold what was sent, or what it held before, so both are in doubt."""
        record = self._records.get(policy)
        if record is not None and record.sent is not None:
            for kept in (record.sent, record.stored):
                for uid, (_, containers) in kept.items():
                    record.doubtful.setdefault(uid, set()).update(containers)
            record.sent, record.dirty = None, True

    def _record(self, policy: str) -> _Record:
        return self._records.setdefault(policy, _Record())

    def _keep(self, policy: str, uid: str, pod_name: str, name: str, cpu: Cpu) -> None:
        before = self._known[uid].get(name)
        if before is not None:
            former = self._records[before.policy]
            former.wanted.discard((uid, name))
            former.handed_over.add((uid, name))
            former.dirty = True
        self._known[uid][name] = Original(policy, cpu)
        self._pod_names[uid] = pod_name
        record = self._record(policy)
        record.wanted.add((uid, name))
        record.handed_over.discard((uid, name))
        record.dirty = True

    def _wanted(self, record: _Record) -> _Stored:
        """What a policy's status should hold now, plus what it handed over, until the new policy's status holds that.

        So at every instant at least one status has the original.
        """
        record.handed_over = {(uid, name) for uid, name in record.handed_over if self._is_on_the_way(uid, name)}
        wanted: _Stored = {}
        for uid, name in sorted(record.wanted | record.handed_over):
            wanted.setdefault(uid, (self._pod_names[uid], {}))[1][name] = self._known[uid][name].cpu
        return wanted

    def _is_on_the_way(self, uid: str, name: str) -> bool:
        known = self.at(uid, name)
        return known is not None and not self.is_stored(known.policy, uid, name)


_Stored = dict[str, tuple[str, dict[str, Cpu]]]
"""Pod UID -> the pod's name and its containers' originals."""


@dataclass(slots=True)
class _Record:
    """One policy's part: what its status should hold, what it holds, and what is being written.

    `handed_over` are containers that other policies took over. `doubtful` are pods, with their containers, that the
    status may or may not hold: they are written anew, or removed.
    """

    wanted: set[tuple[str, str]] = field(default_factory=set)
    handed_over: set[tuple[str, str]] = field(default_factory=set)
    stored: _Stored = field(default_factory=dict)
    sent: _Stored | None = None
    doubtful: dict[str, set[str]] = field(default_factory=dict)
    dirty: bool = False

    def holds(self, uid: str, name: str, cpu: Cpu) -> bool:
        return uid not in self.doubtful and uid in self.stored and self.stored[uid][1].get(name) == cpu

    def changes(self, wanted: _Stored) -> dict[str, Any]:
        found: dict[str, Any] = dict.fromkeys((self.stored.keys() | self.doubtful.keys()) - wanted.keys())
        for uid, (pod_name, containers) in wanted.items():
            if uid in self.doubtful or self.stored.get(uid) != (pod_name, containers):
                before = self.stored.get(uid, ("", {}))[1].keys() | self.doubtful.get(uid, set())
                gone: dict[str, Any] = dict.fromkeys(before - containers.keys())
                found[uid] = {"pod": pod_name, "containers": gone | {n: write(cpu) for n, cpu in containers.items()}}
        return found


def read(policy: str, stored: object) -> Iterator[tuple[str, tuple[str, dict[str, Cpu]]]]:
    """The entries of a status: pod UID, pod name and originals; an invalid entry is logged and left out."""
    for uid, entry in stored.items() if isinstance(stored, dict) else ():
        try:
            containers = {
                name: Cpu(millicores(cpu.get("request")), millicores(cpu.get("limit")))
                for name, cpu in entry["containers"].items()
            }
            yield uid, (str(entry["pod"]), containers)
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            log.warning("%s: status.%s.%s can't be read: %r", policy, FIELD, uid, error)


def write(cpu: Cpu) -> dict[str, str]:
    """CPU resources as Kubernetes quantities."""
    amounts = {"request": cpu.request, "limit": cpu.limit}
    return {kind: format_cpu(amount) for kind, amount in amounts.items() if amount is not None}
