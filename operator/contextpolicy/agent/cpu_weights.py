"""CPU weights: how contested processors are shared, at every level at which containers compete.

Pods compete inside their QoS class's group, and classes with each other. So a container's weight is written in the
container's group and, as the sum over its containers, in its pod's; a class has the sum of its pods' weights, as if
these were their requests.

The kubelet writes a pod's and a container's weight with every resize of them, and a class's every minute and whenever
a pod starts or ends: always from the requests in the API, which no plan moves. So whatever others write is what to put
back later, and ours is written again. Who wrote decides, not the text: under version 2 several requests share one.

Runtimes convert requests to weights in one of two ways there. What a container of a known request had before us shows
which; else what others on the node have, as one runtime has made them all.
"""

from __future__ import annotations

import logging
from collections import defaultdict
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.agent import weight_units as units
from contextpolicy.agent.cgroup_paths import pod_of
from contextpolicy.agent.child_groups import Children
from contextpolicy.agent.failures import GONE, Failures, attempt
from contextpolicy.agent.open_files import OpenFile, OpenFiles, Unwatched
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping
    from pathlib import Path

    from contextpolicy.agent.ledger import Ledger
    from contextpolicy.agent.open_files import FileWatch

log = logging.getLogger(__name__)


class _Wish(NamedTuple):
    """What a group should have, and the policy that wants it."""

    policy: str
    weight: int


class _Members(NamedTuple):
    """Containers and their pods: what each should have, and which are the pods."""

    wishes: dict[Path, _Wish]
    pods: Collection[Path]


class Weights:
    """The CPU weights that policies want on one node, in thousandths of a core; groups are the containers' cgroups.

    Nothing is raised: each method returns the groups, at any level, where it failed.
    """

    def __init__(self, version: int, watch: FileWatch, ledger: Ledger) -> None:
        self._version, self._ledger = version, ledger
        self._files = OpenFiles(self._open, watch)
        self._beside = OpenFiles(self._open, Unwatched())
        self._children = Children()
        self._wanted: dict[str, Mapping[Path, int]] = {}
        self._requests: dict[str, Mapping[Path, int]] = {}

    def apply(self, policy: str, cores: Mapping[Path, int], requests: Mapping[Path, int]) -> Failures:
        """Set the policy's weights and undo any others it had; `requests` are the API's, as far as they are known."""
        self._wanted[policy], self._requests[policy] = cores, requests
        return self._enforce(policy)

    def release(self, policy: str) -> Failures:
        """Undo all weights of the policy."""
        self._wanted.pop(policy, None)
        self._requests.pop(policy, None)
        return self._enforce(policy)

    def knows(self, group: Path) -> bool:
        """Whether the group existed at the last plan, and has not been found gone since."""
        return group in self._files

    def on_other_write(self, path: Path, heard: float) -> Failures:
        """Another process wrote a file that we watch, as we `heard` then."""
        entry = self._ledger.entries.get(path)
        try:
            file = self._files[path.parent]
            text = file.heed()
        except ActuationError as error:
            self._lose(path.parent, error)
            return {path.parent: error}
        if entry is not None and text == entry.ours and (entry.overtook or heard <= file.written):
            entry.overtook = False  # what was written before ours is known already
        elif entry is not None:
            self._ledger.hear(path, text)
        return self._enforce()

    def _enforce(self, policy: str = "") -> Failures:
        """Undo what else the policy had, and write what differs."""
        gone: Failures = {}
        members = self._members(gone)
        classes = {pod.parent for pod in members.pods}
        failures = gone | self._undo(policy, {*members.wishes, *classes})
        wishes = members.wishes | {group: wish for group in classes if (wish := self._class_wish(group, members))}
        failures |= self._write_all(wishes)
        self._files.keep([*wishes, *(path.parent for path in self._ledger.entries)])
        self._beside.keep(child for child in self._children.all() if child not in wishes)
        self._children.keep(wishes)
        return failures

    def _write_all(self, wishes: Mapping[Path, _Wish]) -> Failures:
        """Write what differs, the journal first: an agent killed in between can still undo it."""
        failures: Failures = {}
        differing = []
        for group, wish in wishes.items():
            try:
                if self._intend(group, wish):
                    differing.append(group)
            except ActuationError as error:
                failures[group] = error
                self._lose(group, error)
        unsaved = attempt(self._ledger.save, *differing)
        for group in () if unsaved else differing:
            failures |= attempt(partial(self._write, group, wishes[group]), group)
        for group in unsaved or [group for group in differing if group in failures]:
            self._retract(group, (unsaved or failures)[group])
        return failures | unsaved

    def _members(self, failures: Failures) -> _Members:
        """What the containers that policies name should have, and their pods; those that have ended count no more."""
        owners: dict[Path, str] = {}
        cores: dict[Path, int] = {}
        by_pod: dict[Path, list[Path]] = defaultdict(list)
        for policy, wanted in self._wanted.items():
            for group, amount in wanted.items():
                try:
                    self._files[group].read()
                except ActuationError as error:
                    failures[group] = error
                    self._lose(group, error)
                    self._children.forget(pod_of(group).parent)
                    continue
                owners[group], cores[group] = policy, amount
                by_pod[pod_of(group)].append(group)
        wishes: dict[Path, _Wish] = {}
        linear = self._conversions(by_pod, owners)
        for pod, groups in by_pod.items():
            convert = partial(units.of_container, version=self._version, linear=linear[pod])
            wishes |= {group: _Wish(owners[group], convert(cores[group])) for group in groups}
            beside = self._others(pod, cores)
            others = sum(units.millicores(weight, self._version, linear=linear[pod]) for weight in beside)
            amount = sum(cores[group] for group in groups) + others
            wishes[pod] = _Wish(owners[groups[-1]], units.of_pod(amount, self._version))
        return _Members(wishes, by_pod.keys())

    def _conversions(self, by_pod: Mapping[Path, list[Path]], owners: Mapping[Path, str]) -> dict[Path, bool]:
        """Whether the runtime has converted the requests in each pod linearly."""
        linear_by_pod: dict[Path, bool] = {}
        for pod, groups in by_pod.items():
            for group in groups if self._version == 2 else ():
                file, request = self._files[group], self._requests[owners[group]].get(group, 0)
                entry = self._ledger.entries.get(file.path)
                linear = units.is_linear(int(entry.theirs if entry else file.seen), request)
                if linear is not None:
                    linear_by_pod[pod] = linear
        return {pod: linear_by_pod.get(pod, any(linear_by_pod.values())) for pod in by_pod}

    def _class_wish(self, group: Path, members: _Members) -> _Wish | None:
        """The sum of the pods that are there; None when none of ours is any more.

        Ours are those just read: a listing may still have the one whose place a new one has taken.
        """
        own = [members.wishes[pod] for pod in members.pods if pod.parent == group]
        if not own:
            return None
        others = sum(self._others(group, members.wishes))
        return _Wish(own[-1].policy, min(units.MOST[self._version], sum(wish.weight for wish in own) + others))

    def _others(self, group: Path, wishes: Collection[Path]) -> list[int]:
        """The weights of a group's other children; listed again if one has ended, for another may have come."""
        for _ in range(2):
            found = [self._now(child) for child in self._children.of(group) if child not in wishes]
            if None not in found:
                break
        return [weight for weight in found if weight is not None]

    def _now(self, group: Path) -> int | None:
        """The weight of a group that is not ours; None when it is gone."""
        try:
            return int(self._beside[group].read())
        except ActuationError:
            self._beside.close(group)
            self._children.forget(group.parent)
            return None

    def _intend(self, group: Path, wish: _Wish) -> bool:
        """Note in the journal what is about to be written; False where nothing has to be."""
        file, text = self._files[group], str(wish.weight)
        entry = self._ledger.entries.get(file.path)
        if file.read() == text and (entry is None or entry.policy == wish.policy):
            return False
        self._note(file, wish)
        return True

    def _note(self, file: OpenFile, wish: _Wish) -> None:
        self._ledger.intend(file.path, wish.policy, now=file.seen, ours=str(wish.weight), held=True)
        if file.unheard:
            self._ledger.overtake(file.path, file.seen)

    def _write(self, group: Path, wish: _Wish) -> None:
        file = self._files[group]
        if file.seen != file.read():  # a foreign write meanwhile: realtime tasks can stop us for 0.1 s here
            self._note(file, wish)
            self._ledger.save()
        file.write(str(wish.weight))

    def _retract(self, group: Path, error: ActuationError) -> None:
        path = group / units.FILES[self._version]
        (self._ledger.close if error.reason == GONE else self._ledger.retract)(path)

    def _lose(self, group: Path, error: ActuationError) -> None:
        """The group's file can't be read: reopen it next time."""
        self._files.close(group)
        if error.reason == GONE:
            self._ledger.close(group / units.FILES[self._version])

    def _undo(self, policy: str, kept: Collection[Path]) -> Failures:
        """Put back what others wrote; files that hold another value by now are left alone.

        What can't be put back now stays in the ledger, to be tried again.
        """
        name = units.FILES[self._version]
        left = [path for path in self._ledger.of(policy) if path.name == name and path.parent not in kept]
        failures: Failures = {}
        for path in left:
            failed = attempt(partial(self._put_back, path), path.parent)
            if not failed or failed[path.parent].reason == GONE:
                self._ledger.close(path)
            failures |= failed
        return failures | attempt(self._ledger.save, *(path.parent for path in left))

    def _put_back(self, path: Path) -> None:
        file, entry = self._files[path.parent], self._ledger.entries[path]
        if entry.wrote(file.read()):
            file.write(entry.theirs)
            log.info("%s: restored %s", path, entry.theirs)

    def _open(self, group: Path) -> OpenFile:
        return OpenFile(group / units.FILES[self._version])
