"""CPU limits: write what a resize is about to write, and give way when the resize comes."""

from __future__ import annotations

import logging
from collections import defaultdict
from contextlib import suppress
from typing import TYPE_CHECKING

from contextpolicy.agent.cgroup_paths import pod_of
from contextpolicy.agent.current_limits import CurrentLimits
from contextpolicy.agent.failures import GONE, Failures, attempt
from contextpolicy.agent.limit_undo import LimitUndo
from contextpolicy.agent.steps import limit_steps
from contextpolicy.errors import ActuationError
from contextpolicy.planning.allocation.placement import QUANTUM

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping
    from pathlib import Path

    from contextpolicy.agent.control_files import ControlFile, ControlFiles
    from contextpolicy.agent.current_limits import ContainerLimits
    from contextpolicy.agent.ledger import Entry, Ledger
    from contextpolicy.agent.steps import PodLimits

log = logging.getLogger(__name__)


class Limits:
    """The CPU limits that policies want on one node, in thousandths of a core, None for no limit.

    Groups are the containers' cgroups.

    Nothing is raised: each method returns the groups, containers or pods, where it failed.
    """

    def __init__(self, files: ControlFiles, ledger: Ledger) -> None:
        self._files, self._ledger = files, ledger
        self._current = CurrentLimits(files, ledger)
        self._undoing = LimitUndo(files, ledger, self._current)
        self._wanted: dict[str, Mapping[Path, int | None]] = {}
        self._held: dict[str, set[Path]] = {}
        """The containers whose limits are held, and their pods."""
        self._originals: dict[str, Mapping[Path, int | None]] = {}
        self._owned: dict[str, Collection[Path]] = {}
        """The pods that have a limit of their own, which is never written."""
        self._yielded: set[Path] = set()
        """Containers that keep an external write until the policy's next plan."""

    def apply(  # noqa: PLR0913 - all that a plan says of limits
        self,
        policy: str,
        limits: Mapping[Path, int | None],
        held: Collection[Path],
        originals: Mapping[Path, int | None],
        *,
        owned: Collection[Path] = (),
        again: bool = False,
    ) -> Failures:
        """Set the policy's limits and undo any others it had. `held` ones are restored after every foreign write.

        `originals` are the API's limits from before any policy: what undoing puts back, also if the API has agreed. A
        limit that is the original is what the container had, also where the kernel has another (`_original`). `owned`
        are pods with a limit of their own, which no container of theirs exceeds. `again`: this is no new plan, and what
        an owner wrote since the first time stays, where the limit is the same.
        """
        before = self._wanted.get(policy, {})
        news = {group for group in {*before, *limits} if not again or before.get(group, 0) != limits.get(group, 0)}
        self._yielded -= news
        self._wanted[policy], self._held[policy] = limits, {*held, *map(pod_of, held)}
        self._originals[policy], self._owned[policy] = originals, owned
        failures = self._enforce(policy, news)
        wanted = self._files.paths(self._groups(policy))
        lost = {path: entry for path, entry in self._own(policy).items() if path not in wanted}
        failures |= self._undoing.undo(lost, self._containers())
        self._keep()
        return failures

    def release(self, policy: str, *, leave_agreed: bool = False) -> Failures:
        """Undo all limits of the policy; `leave_agreed`: but for what the API has as well."""
        self._yielded.difference_update(self._wanted.pop(policy, ()))
        failures = self._undoing.undo(self._own(policy), self._containers(), leave_agreed=leave_agreed)
        self._held.pop(policy, None)
        self._originals.pop(policy, None)
        self._owned.pop(policy, None)
        self._keep()
        return failures

    def standing(self, policy: str, groups: Collection[Path]) -> dict[Path, int | None]:
        """What the policy wants of these groups so far; what they have where it wants nothing yet."""
        wanted, found = self._wanted.get(policy, {}), {}
        for group in groups:
            with suppress(ActuationError):
                found[group] = wanted[group] if group in wanted else self._current.of(group)
        return found

    def settle(self, group: Path, limit: int) -> None:
        """The API has `limit` in force: if an earlier run of the agent wrote the same, it is confirmed."""
        with suppress(ActuationError):
            file = self._files[group]
            entry = self._ledger.entries.get(file.path)
            unsure = entry is not None and (entry.inherited or entry.overtook)
            if unsure and file.read() == file.text(limit):
                self._agree(file.path, file.seen)

    def knows(self, group: Path) -> bool:
        """Whether the group existed at the last plan, and has not been found gone since."""
        return group in self._files

    def on_other_write(self, path: Path, heard: float) -> Failures:
        """Another process wrote a file that we watch, as we `heard` then; the package's docstring has the rules."""
        written, path = path, path.parent / self._files.form.file
        entry = self._ledger.entries.get(path)
        try:
            file = self._files[path.parent]
            if not file.is_news(written):
                return {}
            text = file.heed()
        except ActuationError as error:
            self._current.lose(path.parent, error)
            return {path.parent: error}
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
        failures: Failures = {}
        for policy in self._owners(path.parent):
            failures |= self._enforce(policy)
        return failures | attempt(self._ledger.save, path.parent)

    def _give_way(self, path: Path, text: str) -> None:
        """Keep a foreign value until the next plan, or until its owner writes the plan's."""
        group = path.parent
        for policy, wanted in self._wanted.items():
            if group in wanted and text != self._files[group].text(self._limit(policy, group)):
                log.info("%s: external write of %s; yielding until the next plan", path, text)
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

    def _enforce(self, policy: str, news: Collection[Path] | None = None) -> Failures:
        """Write what differs. The kernel refuses if the kubelet has just lowered the pod: recompute and retry, once.

        `news` are the containers of which a plan says something new, None without a plan. There it overrides foreign
        writes; elsewhere one that the watch has yet to report stands until then.
        """
        return self._write_once(policy, news) and self._write_once(policy, news)

    def _write_once(self, policy: str, news: Collection[Path] | None) -> Failures:
        by_pod, failures = self._now_and_wanted(policy, news)
        return failures | self._write(policy, self._current.pods(by_pod, self._owned[policy], failures))

    def _now_and_wanted(
        self, policy: str, news: Collection[Path] | None
    ) -> tuple[dict[Path, ContainerLimits], Failures]:
        """What the policy's containers have and should have, by pod; and those whose current limit can't be read."""
        by_pod: dict[Path, ContainerLimits] = defaultdict(dict)
        failures: Failures = {}
        for group in self._wanted[policy]:
            try:
                now = self._current.of(group)
            except ActuationError as error:
                self._current.lose(group, error)
                failures[group] = error
            else:
                share = self._limit(policy, group)
                if group not in self._yielded and (group in (news or ()) or not self._files[group].unheard):
                    by_pod[pod_of(group)][group] = (now, now if self._is_rounded(policy, group, now) else share)
                if news is not None and now == share:
                    self._remember(policy, group)
        return by_pod, failures

    def _is_rounded(self, policy: str, group: Path, now: int | None) -> bool:
        """Whether what is there is what the systemd driver made of the share: a multiple of 10m (runc #4622).

        Of a share that was written last, or that is the original: else it is an earlier limit that looks like it.
        """
        share = self._limit(policy, group)
        if share is None or now != -(-share // QUANTUM) * QUANTUM:
            return False
        file = self._files[group]
        entry = self._ledger.entries.get(file.path)
        written = file.ours or (entry.ours if entry else "")
        return file.text(share) == written if written else share == self._original(policy, group)

    def _limit(self, policy: str, group: Path) -> int | None:
        """What the container should have, once its file has been read."""
        share = self._wanted[policy][group]
        return self._original(policy, group) if share == self._originals[policy][group] else share

    def _original(self, policy: str, group: Path) -> int | None:
        """What the container had before any policy, once its file has been read.

        That is what the kubelet made of the API's limit: nothing for a container with processors of its own (static CPU
        manager, since Kubernetes 1.33), nor with `cpuCFSQuota: false`. No policy takes a limit away, and nobody has put
        one there: the ledger shows it, and the file where that has no entry. A larger limit may be a plan's.
        """
        file = self._files[group]
        entry = self._ledger.entries.get(file.path)
        theirs = file.seen if entry is None else entry.theirs
        return None if file.amount(theirs) is None else self._originals[policy][group]

    def _remember(self, policy: str, group: Path) -> None:
        """What the policy wants is in force already: its undoing is ours as well."""
        file = self._files[group]
        original, in_owned = file.text(self._original(policy, group)), pod_of(group) in self._owned[policy]
        held = self._holds(group)
        self._ledger.remember(file.path, policy, now=file.seen, original=original, held=held, in_owned=in_owned)

    def _keep(self) -> None:
        """Close the files of what is neither wanted nor still to be undone, of the pods, and of those beside them."""
        wanted = {group for known in self._wanted for group in self._groups(known)}
        wanted.update(path.parent for path in self._ledger.entries.keys() - self._files.paths(wanted))
        self._current.keep(wanted)

    def _write(self, policy: str, pods: Iterable[PodLimits]) -> Failures:
        """Write the limits, the ledger first: an agent killed in between can still undo them."""
        steps = limit_steps(pods)
        for step in steps:
            self._intend(policy, self._files[step.group], step.amount)
        failures = attempt(self._ledger.save, *(step.group for step in steps))
        for step in () if failures else steps:
            file = self._files[step.group]
            try:
                if file.seen != file.read():  # a foreign write meanwhile: realtime tasks can stop us for 0.1 s here
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
        group = file.path.parent
        original = file.text(self._original(policy, group)) if group in self._originals[policy] else None
        self._ledger.intend(
            file.path,
            policy,
            now=file.seen,
            ours=file.text(amount),
            held=self._holds(group),
            original=original,
            in_owned=pod_of(group) in self._owned[policy],
        )
        if file.unheard:
            self._ledger.overtake(file.path, file.seen)

    def _holds(self, group: Path) -> bool:
        return any(group in held for held in self._held.values())

    def _own(self, policy: str) -> dict[Path, Entry]:
        return {p: e for p, e in self._ledger.of(policy).items() if p.name == self._files.form.file}

    def _groups(self, policy: str) -> set[Path]:
        """The groups of the containers that the policy limits, and of their pods."""
        wanted = self._wanted.get(policy, {})
        return {*wanted, *map(pod_of, wanted)}

    def _containers(self) -> set[Path]:
        """The groups of the containers that any policy limits."""
        return {container for known in self._wanted.values() for container in known}

    def _owners(self, group: Path) -> list[str]:
        """The policies that limit this container, or containers of this pod; an entry's own may be gone by now."""
        return [policy for policy in self._wanted if group in self._groups(policy)]
