"""CPU limits: write what a resize is about to write, and give way when the resize comes."""

from __future__ import annotations

import logging
from collections import defaultdict
from contextlib import suppress
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING

from contextpolicy.agent.cgroup_paths import is_pod, pod_of
from contextpolicy.agent.control_files import Children, ControlFile, ControlFiles
from contextpolicy.agent.failures import GONE, Failures, attempt
from contextpolicy.agent.steps import PodLimits, limit_steps
from contextpolicy.errors import ActuationError
from contextpolicy.planning.allocation.placement import QUANTUM

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping
    from pathlib import Path

    from contextpolicy.agent.ledger import Entry, Ledger

    _Containers = dict[Path, tuple[int | None, int | None]]
    """Of each container (now, wanted)."""

log = logging.getLogger(__name__)

NOTHING: Mapping[Path, int | None] = MappingProxyType({})


class Limits:
    """The CPU limits that policies want on one node, in thousandths of a core, None for no limit.

    Groups are the containers' cgroups.

    Nothing is raised: each method returns the groups, containers or pods, where it failed.
    """

    def __init__(self, files: ControlFiles, ledger: Ledger) -> None:
        self._files, self._ledger = files, ledger
        self._children, self._siblings = Children(), ControlFiles(files.form)
        self._wanted: dict[str, Mapping[Path, int | None]] = {}
        self._held: dict[str, set[Path]] = {}
        """The containers whose limits are held, and their pods."""
        self._originals: dict[str, Mapping[Path, int | None]] = {}
        self._yielded: set[Path] = set()
        """Containers that keep what somebody else decided, until the policy's next plan."""

    def apply(
        self,
        policy: str,
        limits: Mapping[Path, int | None],
        held: Collection[Path] = (),
        originals: Mapping[Path, int | None] = NOTHING,
    ) -> Failures:
        """Set the policy's limits and undo any others it had. `held` ones are restored whoever overwrites them.

        `originals` are what the containers had before any policy: what undoing puts back, also if the API has agreed.
        """
        self._yielded.difference_update(self._wanted.get(policy, ()), limits)
        self._wanted[policy], self._held[policy] = limits, {*held, *map(pod_of, held)}
        self._originals[policy] = originals
        failures = self._enforce(policy, anew=True)
        wanted = self._paths(self._groups(policy))
        failures |= self._undo({path: e for path, e in self._own(policy).items() if path not in wanted})
        self._keep()
        return failures

    def release(self, policy: str, *, leave_agreed: bool = False) -> Failures:
        """Undo all limits of the policy; `leave_agreed`: but for what the API has as well."""
        self._yielded.difference_update(self._wanted.pop(policy, ()))
        failures = self._undo(self._own(policy), leave_agreed=leave_agreed)
        self._held.pop(policy, None)
        self._originals.pop(policy, None)
        self._keep()
        return failures

    def standing(self, policy: str, groups: Collection[Path]) -> dict[Path, int | None]:
        """What the policy wants of these groups so far; what they have where it wants nothing yet."""
        wanted, found = self._wanted.get(policy, {}), {}
        for group in groups:
            with suppress(ActuationError):
                found[group] = wanted[group] if group in wanted else self._now(group)
        return found

    def settle(self, group: Path, limit: int) -> None:
        """The API has `limit` in force: if an earlier run of the agent wrote the same, it is confirmed."""
        with suppress(ActuationError):
            file = self._files[group]
            entry = self._ledger.entries.get(file.path)
            unsure = entry is not None and (entry.inherited or entry.overtook)
            if unsure and file.text(limit) == file.read():
                self._agree(file.path, file.seen)

    def knows(self, group: Path) -> bool:
        """Whether it was there at the last plan, and has not been found gone since."""
        return group in self._files

    def on_other_write(self, path: Path, heard: float) -> Failures:
        """Somebody else wrote a file that we watch, as we `heard` then; the package's docstring has the rules."""
        entry = self._ledger.entries.get(path)
        policy = entry.policy if entry else self._owner(path.parent)
        try:
            file = self._files[path.parent]
            text = file.heed()
        except ActuationError:
            self._ledger.close(path)
            return {}
        if entry is not None and (entry.overtook or heard <= file.written) and text == entry.ours:
            return {}
        if entry is not None and (entry.held or text == entry.theirs or text in entry.earlier):
            self._ledger.hear(path, text)
        elif not self._holds(path.parent):
            if entry is not None and text == entry.ours:
                self._agree(path, text)
            else:
                self._close(path)
                self._give_way(path, text)
        failures = self._enforce(policy) if policy is not None else {}
        return failures | attempt(self._ledger.save, path.parent)

    def _give_way(self, path: Path, text: str) -> None:
        """Keep a foreign value until the next plan, or until its owner writes the plan's."""
        group = path.parent
        for policy, wanted in self._wanted.items():
            if group in wanted and text != self._files[group].text(wanted[group]):
                log.info("%s: somebody else wants %s", path, text)
                self._yielded.add(group)
            elif group in wanted:
                self._yielded.discard(group)
                self._remember(policy, group)

    def _agree(self, path: Path, text: str) -> None:
        """A resize came and agrees."""
        self._ledger.agree(path, text)
        self._close_pod(path)

    def _close(self, path: Path) -> None:
        self._ledger.close(path)
        self._close_pod(path)

    def _close_pod(self, path: Path) -> None:
        """Close the entry of the file's pod with the last container's on which the API has yet to agree.

        The pod's own write may never be seen: the kubelet does not rewrite a pod limit that is right already.
        """
        pod, name = path.parent.parent, path.name
        entries = self._ledger.entries.items()
        if all(entry.agreed for other, entry in entries if other.parent.parent == pod and other.name == name):
            self._ledger.close(pod / name)

    def _enforce(self, policy: str, *, anew: bool = False) -> Failures:
        """Write what differs. The kernel refuses if the kubelet has just lowered the pod: recompute and retry, once.

        A new plan overtakes what others wrote; otherwise a write that we have yet to be told of is left until then.
        """
        return self._write_once(policy, anew=anew) and self._write_once(policy, anew=anew)

    def _write_once(self, policy: str, *, anew: bool) -> Failures:
        by_pod, failures = self._now_and_wanted(policy, anew=anew)
        return failures | self._write(policy, self._pods(by_pod, failures))

    def _pods(self, by_pod: Mapping[Path, _Containers], failures: Failures) -> list[PodLimits]:
        """The pods with all that their limits depend on; those that can't be read become `failures`."""
        pods = []
        for pod, containers in by_pod.items():
            try:
                pods.append(PodLimits(pod, self._now(pod), self._others(pod, containers), containers))
            except ActuationError as error:
                self._lose(pod, error)
                failures[pod] = error
        return pods

    def _now_and_wanted(self, policy: str, *, anew: bool) -> tuple[dict[Path, _Containers], Failures]:
        """What the policy's containers have and should have, by pod; and those of which the first can't be read."""
        by_pod: dict[Path, _Containers] = defaultdict(dict)
        failures: Failures = {}
        for group, share in self._wanted[policy].items():
            try:
                now = self._now(group)
            except ActuationError as error:
                self._lose(group, error)
                failures[group] = error
            else:
                if group not in self._yielded and (anew or not self._files[group].unheard):
                    by_pod[pod_of(group)][group] = (now, now if _is_rounded(share, now) else share)
                if anew and now == share:
                    self._remember(policy, group)
        return by_pod, failures

    def _remember(self, policy: str, group: Path) -> None:
        """What the policy wants is in force already: its undoing is ours as well."""
        file, originals = self._files[group], self._originals[policy]
        if group in originals:
            original = file.text(originals[group])
            self._ledger.remember(file.path, policy, now=file.seen, original=original, held=self._holds(group))

    def _lose(self, group: Path, error: ActuationError) -> None:
        """The group's file can't be read: open it anew the next time."""
        self._files.close(group)
        if error.reason == GONE:
            self._ledger.close(group / self._files.form.file)

    def _others(self, pod: Path, containers: Collection[Path]) -> int:
        """The sum of the pod's other containers' limits; those without one (the sandbox) do not count."""
        for _ in range(2):
            amounts = [self._beside(group, pod) for group in self._children.of(pod) if group not in containers]
            if None not in amounts:
                break
        return sum(amount or 0 for amount in amounts)

    def _beside(self, group: Path, pod: Path) -> int | None:
        """The limit of a container that is not ours; None when it has ended, and another may have come in its place."""
        try:
            file = self._siblings[group]
            return file.amount(file.read()) or 0
        except ActuationError:
            self._siblings.close(group)
            self._children.forget(pod)
            return None

    def _now(self, group: Path) -> int | None:
        file = self._files[group]
        return file.amount(file.read())

    def _keep(self) -> None:
        """Close the files of what is neither wanted nor still to be undone, of the pods, and of those beside them."""
        wanted = {group for known in self._wanted for group in self._groups(known)}
        wanted.update(path.parent for path in self._ledger.entries.keys() - self._paths(wanted))
        self._files.keep(wanted)
        self._children.keep(wanted)
        self._siblings.keep(self._children.all())

    def _write(self, policy: str, pods: Iterable[PodLimits]) -> Failures:
        """Write the limits, the ledger first: an agent killed in between can still undo them."""
        steps = limit_steps(pods)
        for step in steps:
            self._intend(policy, self._files[step.group], step.amount)
        failures = attempt(self._ledger.save, *(step.group for step in steps))
        for step in () if failures else steps:
            file = self._files[step.group]
            try:
                if file.seen != file.read():  # somebody else wrote meanwhile: realtime tasks can stop us for 0.1 s here
                    self._intend(policy, file, step.amount)
                    self._ledger.save()
                file.write(file.text(step.amount))
            except ActuationError as error:
                failures[step.group] = error
        self._retract(failures)
        return failures

    def _retract(self, failures: Failures) -> None:
        for group, error in failures.items():
            path = group / self._files.form.file
            (self._ledger.close if error.reason == GONE else self._ledger.retract)(path)

    def _intend(self, policy: str, file: ControlFile, amount: int | None) -> None:
        group, originals = file.path.parent, self._originals[policy]
        original = file.text(originals[group]) if group in originals else None
        held = self._holds(group)
        self._ledger.intend(file.path, policy, now=file.seen, ours=file.text(amount), held=held, original=original)
        if file.unheard:
            self._ledger.overtake(file.path, file.seen)

    def _holds(self, group: Path) -> bool:
        return any(group in held for held in self._held.values())

    def _fits(self, group: Path, limit: int | None) -> bool:
        """Whether a pod's limit is no less than the sum of its containers'; always true of a container's."""
        return limit is None or not is_pod(group) or self._others(group, ()) <= limit

    def _own(self, policy: str) -> dict[Path, Entry]:
        return {p: e for p, e in self._ledger.of(policy).items() if p.name == self._files.form.file}

    def _groups(self, policy: str) -> set[Path]:
        """The groups of the containers that the policy limits, and of their pods."""
        wanted = self._wanted.get(policy, {})
        return {*wanted, *map(pod_of, wanted)}

    def _paths(self, groups: Iterable[Path]) -> set[Path]:
        """The files of groups; those of open ones, whose hash is known, at a tenth of the cost."""
        files, name = self._files, self._files.form.file
        return {files[group].path if group in files else group / name for group in groups}

    def _owner(self, group: Path) -> str | None:
        return next((policy for policy in self._wanted if group in self._groups(policy)), None)

    def _undo(self, entries: Mapping[Path, Entry], *, leave_agreed: bool = False) -> Failures:
        """Put back the originals, and where there are none what others wrote, containers before pods.

        `leave_agreed`: put back only what others wrote. Files that hold another value by now are left alone. What can't
        be put back now stays in the ledger, for the policy's next plan or the agent's end.
        """
        entries = {**self._too_small(), **entries} if entries else entries
        originals = {p: entry for p, entry in entries.items() if entry.original is not None and not leave_agreed}
        failures = self._restore(originals) and self._restore(originals)
        rest = entries.keys() - originals.keys()
        for path in sorted(rest, key=lambda path: len(path.parts), reverse=True):
            failures |= attempt(partial(self._put_back, path, entries[path]), path.parent)
        for path in entries:
            failed = failures.get(path.parent)
            if failed.reason == GONE if failed else not self._is_too_small(path, entries[path]):
                self._ledger.close(path)
        return failures | attempt(self._ledger.save, *(path.parent for path in entries))

    def _too_small(self) -> dict[Path, Entry]:
        """Pods that no policy limits any more, but which could not be put back so far."""
        wanted = self._paths({group for policy in self._wanted for group in self._groups(policy)})
        name, entries = self._files.form.file, self._ledger.entries
        return {p: e for p, e in entries.items() if p.name == name and is_pod(p.parent) and p not in wanted}

    def _is_too_small(self, path: Path, entry: Entry) -> bool:
        """Whether a pod's former limit is less than its containers' still add up to."""
        with suppress(ActuationError):
            return is_pod(path.parent) and entry.wrote(self._files[path.parent].read())
        return False

    def _restore(self, entries: Mapping[Path, Entry]) -> Failures:
        """Put back containers' originals; their pods only grow, as for a plan."""
        by_pod: dict[Path, _Containers] = defaultdict(dict)
        failures: Failures = {}
        for path, entry in entries.items():
            group = path.parent
            try:
                now = self._now(group)
            except ActuationError as error:
                failures[group] = error
            else:
                if entry.knows(self._files[group].seen):
                    by_pod[pod_of(group)][group] = (now, self._files[group].amount(entry.original or ""))
        for step in limit_steps(self._pods(by_pod, failures)):
            file = self._files[step.group]
            log.info("%s: put back %s", file.path, file.text(step.amount))
            failures |= attempt(partial(file.write, file.text(step.amount)), step.group)
        return failures

    def _put_back(self, path: Path, entry: Entry) -> None:
        file = self._files[path.parent]
        if entry.wrote(file.read()) and self._fits(path.parent, file.amount(entry.theirs)):
            file.write(entry.theirs)
            log.info("%s: put back %s", path, entry.theirs)


def _is_rounded(limit: int | None, now: int | None) -> bool:
    """Whether what is there is what the systemd driver makes of a limit: a multiple of 10m (runc #4622)."""
    return limit is not None and now == -(-limit // QUANTUM) * QUANTUM
