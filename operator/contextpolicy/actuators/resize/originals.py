"""What containers had before any policy: kept in the policies' status, which only the operator may write. Pure.

Level-triggered: `note` and `drop` change what a status should hold, `inspect` takes what the watch shows that it holds,
and `changes` is the difference. A container is resized only after its original is stored, so a restarted operator
always knows how to put it back.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from contextpolicy.actuators.resize.originals_record import OriginalsRecord
from contextpolicy.actuators.resize.stored_originals import StoredPod, write

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from contextpolicy.actuators.resize.stored_originals import EntrySignatures, StoredOriginals
    from contextpolicy.cluster.pods import Cpu


@dataclass(frozen=True, slots=True)
class Original:
    """What a container had before `policy` first resized it."""

    policy: str
    cpu: Cpu


_NONE: Mapping[str, Original] = {}


class Originals:
    """The originals of all policies. One policy keeps each; it moves when another policy takes the container over."""

    def __init__(self, signatures: EntrySignatures) -> None:
        self._signatures = signatures
        self._known: dict[str, dict[str, Original]] = defaultdict(dict)
        self._pod_names: dict[str, str] = {}
        self._attended: set[str] = set()
        """UIDs of the pods that an agent writes or has written."""
        self._inherited: dict[str, set[str]] = {}
        self._records: dict[str, OriginalsRecord] = {}
        self._unproven: dict[str, dict[str, str]] = {}
        """By policy and pod UID, why nobody knows whether the entry is true: it stays, and the pod is left alone."""

    def knows(self, policy: str) -> bool:
        """Whether the policy's status was loaded; the only method that may be called on any thread."""
        return policy in self._records

    def recall(self, policy: str, stored: StoredOriginals, exists: Callable[[str], bool]) -> None:
        """Load what a policy's status holds, once, when the policy first appears; pods that are gone are left out.

        Two policies may hold the same container if the operator was killed during a takeover. Both then hold the same
        value, so either may keep it. What no status holds does not take a container from the policy that has it.
        """
        if policy in self._records:
            return
        record = self._record(policy)
        record.hold(stored.raw, stored.version)
        record.unproven = {uid: stored.raw[uid] for uid in stored.unproven}
        record.dirty = bool(stored.raw)
        self._unproven[policy] = {uid: why for uid, why in stored.unproven.items() if exists(uid)}
        for uid, entry in stored.pods.items():
            for name, cpu in entry.containers.items() if exists(uid) else ():
                if record.mentions(uid, name) or self.at(uid, name) is None:
                    self._keep(policy, uid, entry.pod, name, cpu)
            if entry.agent and uid in self._known:
                self._attended.add(uid)
                self._inherited.setdefault(policy, set()).add(uid)

    def unproven(self, policy: str) -> Mapping[str, str]:
        """UIDs of the pods whose entry in the policy's status can't be proven, with a message for users."""
        return self._unproven.get(policy, {})

    def doubt(self, uid: str) -> str | None:
        """Why the pod must be left alone: some status has an entry for it that can't be proven."""
        return next((pods[uid] for pods in self._unproven.values() if uid in pods), None)

    def inspect(self, policy: str, raw: Mapping[str, Any], version: int) -> bool:
        """Compare with what the watch shows of the policy's status; whether another client has changed it.

        What was changed is written again with the next `changes`.
        """
        record = self._records.get(policy)
        return record is not None and record.inspect(raw, version)

    def forget(self, policy: str) -> None:
        """The policy is gone, and its status with it."""
        for uid, name in list(self.of(policy)):
            self.drop(uid, name)
        self._records.pop(policy, None)
        self._inherited.pop(policy, None)
        self._unproven.pop(policy, None)

    def attend(self, uid: str) -> None:
        """An agent writes the pod, or did: its files may differ from the API then, also for the next operator."""
        if uid not in self._attended:
            self._attended.add(uid)
            for original in self.in_pod(uid).values():
                self._records[original.policy].dirty = True

    def inherited(self, policy: str) -> frozenset[str]:
        """UIDs of the policy's pods that an agent had written when an earlier operator ended, until `settle`."""
        return frozenset(self._inherited.get(policy, ()))

    def settle(self, policy: str, uids: Iterable[str]) -> None:
        """What an agent had written in these pods before is taken care of."""
        self._inherited.get(policy, set()).difference_update(uids)

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
            self._leave(uid)

    def drop_pod(self, uid: str) -> None:
        """The pod is gone."""
        for name in list(self.in_pod(uid)):
            self.drop(uid, name)
        self._leave(uid)
        for policy, pods in self._unproven.items():
            if pods.pop(uid, None) is not None:
                self._records[policy].dirty = True

    def _leave(self, uid: str) -> None:
        """Nothing of the pod is kept any more: what an agent had written in it does not matter."""
        self._attended.discard(uid)
        for uids in self._inherited.values():
            uids.discard(uid)

    def is_stored(self, policy: str, uid: str, name: str) -> bool:
        """Whether the status holds the original, so that the operator would know it after a restart."""
        known = self._known.get(uid, _NONE).get(name)
        held = self._records[policy].certain.get((uid, name)) if known and known.policy == policy else None
        return known is not None and held == known.cpu

    def changes(self, policy: str) -> dict[str, Any]:
        """The merge patch that `status.originals` needs; empty when it needs none, or while one is under way."""
        record = self._records.get(policy)
        if record is None or record.sent is not None or not record.dirty:
            return {}
        found = record.changes(self._wanted(policy, record))
        record.dirty = bool(found)
        return found

    def send(self, policy: str) -> None:
        """The patch from `changes` has been sent."""
        record = self._records[policy]
        record.sent, record.dirty = self._wanted(policy, record), False

    def succeed(self, policy: str, version: int) -> bool:
        """What was sent is stored in this version; policies that handed some of it over may now remove it.

        Returns whether another client has changed it since.
        """
        record = self._records.get(policy)
        if record is None or record.sent is None:
            return False
        changed = record.succeed(version)
        for other in self._records.values():
            other.dirty |= bool(other.handed_over)
        return changed

    def fail(self, policy: str) -> None:
        """The write failed: the status may hold what was sent, or what it held before."""
        record = self._records.get(policy)
        if record is not None:
            record.fail()

    def _record(self, policy: str) -> OriginalsRecord:
        return self._records.setdefault(policy, OriginalsRecord())

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

    def _wanted(self, policy: str, record: OriginalsRecord) -> dict[str, Any]:
        """What a policy's status should hold now, plus what it handed over, until the new policy's status holds that.

        So at every instant at least one status has the original.
        """
        record.handed_over = {(uid, name) for uid, name in record.handed_over if self._is_on_the_way(uid, name)}
        wanted: dict[str, StoredPod] = {}
        for uid, name in sorted(record.wanted | record.handed_over):
            blank = StoredPod(self._pod_names[uid], {}, uid in self._attended)
            wanted.setdefault(uid, blank).containers[name] = self._known[uid][name].cpu
        sign = self._signatures.of
        kept = {uid: record.unproven[uid] for uid in self.unproven(policy)}
        return kept | {uid: write(entry._replace(signature=sign(policy, uid, entry))) for uid, entry in wanted.items()}

    def _is_on_the_way(self, uid: str, name: str) -> bool:
        known = self.at(uid, name)
        return known is not None and not self.is_stored(known.policy, uid, name)
