"""CPU limits: write what a resize is about to write, and give way when the resize comes."""

from __future__ import annotations

import logging
from collections import defaultdict
from contextlib import suppress
from typing import TYPE_CHECKING

from contextpolicy.agent.cgroup_paths import is_pod, pod_of
from contextpolicy.agent.control_files import Children, ControlFile, ControlFiles
from contextpolicy.agent.failures import GONE, Failures, attempt
from contextpolicy.agent.steps import PodLimits, limit_steps
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping
    from pathlib import Path

    from contextpolicy.agent.ledger import Entry, Ledger

    _Containers = dict[Path, tuple[int | None, int | None]]
    """Of each container (now, wanted)."""

log = logging.getLogger(__name__)


class Limits:
    """The CPU limits that policies want on one node, in thousandths of a core, None for no limit.

    Groups are the containers' cgroups.

    Nothing is raised: each method returns the groups, containers or pods, where it failed.
    """

    def __init__(self, files: ControlFiles, ledger: Ledger) -> None:
        self._files, self._ledger = files, ledger
        self._children, self._siblings = Children(), ControlFiles(files.form)
        self._wanted: dict[str, dict[Path, int | None]] = {}
        self._held: dict[str, set[Path]] = {}
        """The containers whose limits are held, and their pods."""

    def apply(self, policy: str, limits: Mapping[Path, int | None], held: Collection[Path] = ()) -> Failures:
        """Set the policy's limits and undo any others it had. `held` ones are restored whoever overwrites them."""
        self._wanted[policy], self._held[policy] = dict(limits), {*held, *map(pod_of, held)}
        failures = self._enforce(policy, anew=True)
        wanted = self._paths(self._groups(policy))
        failures |= self._undo({path: e for path, e in self._own(policy).items() if path not in wanted})
        self._keep()
        return failures

    def release(self, policy: str) -> Failures:
        """Undo all limits of the policy."""
        failures = self.apply(policy, {})
        self._wanted.pop(policy, None)
        self._held.pop(policy, None)
        return failures

    def wanted(self, policy: str) -> Mapping[Path, int | None]:
        """The policy's limits."""
        return self._wanted.get(policy, {})

    def settle(self, group: Path, limit: int) -> None:
        """The API has `limit` in force: if an earlier run of the agent wrote the same, it is confirmed."""
        with suppress(ActuationError):
            file = self._files[group]
            entry = self._ledger.entries.get(file.path)
            unsure = entry is not None and (entry.inherited or entry.overtook)
            if unsure and file.text(limit) == file.read():
                self._close(file.path)

    def knows(self, group: Path) -> bool:
        """Whether it was there at the last plan, and has not been found gone since."""
        return group in self._files

    def on_other_write(self, path: Path) -> Failures:
        """Somebody else wrote a file that we watch; the package's docstring has the rules."""
        entry = self._ledger.entries.get(path)
        policy = entry.policy if entry else self._owner(path.parent)
        try:
            text = self._files[path.parent].heed()
        except ActuationError:
            self._ledger.close(path)
            return {}
        if entry is not None and entry.overtook and text == entry.ours:
            return {}
        if entry is not None and (entry.held or text == entry.theirs or text in entry.earlier):
            self._ledger.hear(path, text)
        elif not self._holds(path.parent):
            self._close(path)
            self._give_way(path, text)
        failures = self._enforce(policy) if policy is not None else {}
        return failures | attempt(self._ledger.save, path.parent)

    def _give_way(self, path: Path, text: str) -> None:
        """Keep a foreign value until the next plan."""
        for wanted in self._wanted.values():
            if path.parent in wanted and text != self._files[path.parent].text(wanted[path.parent]):
                log.info("%s: somebody else wants %s", path, text)
                del wanted[path.parent]

    def _close(self, path: Path) -> None:
        """Close an entry, and its pod's with the last container's.

        The pod's own write may never be seen: the kubelet does not rewrite a pod limit that is right already.
        """
        self._ledger.close(path)
        pod = path.parent.parent
        if not any(other.parent.parent == pod and other.name == path.name for other in self._ledger.entries):
            self._ledger.close(pod / path.name)

    def _enforce(self, policy: str, *, anew: bool = False) -> Failures:
        """Write what differs. The kernel refuses if the kubelet has just lowered the pod: recompute and retry, once.

        A new plan overtakes what others wrote; otherwise a write that we have yet to be told of is left until then.
        """
        return self._write_once(policy, anew=anew) and self._write_once(policy, anew=anew)

    def _write_once(self, policy: str, *, anew: bool) -> Failures:
        by_pod, failures = self._now_and_wanted(policy, anew=anew)
        pods = []
        for pod, containers in by_pod.items():
            try:
                pods.append(PodLimits(pod, self._now(pod), self._others(pod, containers), containers))
            except ActuationError as error:
                self._lose(pod, error)
                failures[pod] = error
        return failures | self._write(policy, pods)

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
                if anew or not self._files[group].unheard:
                    by_pod[pod_of(group)][group] = (now, share)
        return by_pod, failures

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
        held = self._holds(file.path.parent)
        self._ledger.intend(file.path, policy, now=file.seen, ours=file.text(amount), held=held)
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

    def _undo(self, entries: Mapping[Path, Entry]) -> Failures:
        """Put back what others wrote, containers before pods; files that hold another value by now are left alone.

        What can't be put back now stays in the ledger, for the policy's next plan or the agent's end.
        """
        failures: Failures = {}
        for path, entry in sorted(entries.items(), key=lambda item: len(item[0].parts), reverse=True):
            try:
                self._put_back(path, entry)
            except ActuationError as error:
                failures[path.parent] = error
                if error.reason != GONE:
                    continue
            self._ledger.close(path)
        return failures | attempt(self._ledger.save, *(path.parent for path in entries))

    def _put_back(self, path: Path, entry: Entry) -> None:
        file = self._files[path.parent]
        if entry.wrote(file.read()) and self._fits(path.parent, file.amount(entry.theirs)):
            file.write(entry.theirs)
            log.info("%s: put back %s", path, entry.theirs)
