"""Puts CPU limits back: the originals, and where there are none what others wrote, containers before pods."""

from __future__ import annotations

import logging
from collections import defaultdict
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING

from contextpolicy.agent.cgroup_paths import is_pod, pod_of
from contextpolicy.agent.failures import GONE, Failures, attempt
from contextpolicy.agent.steps import limit_steps
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping
    from pathlib import Path

    from contextpolicy.agent.control_files import ControlFile, ControlFiles
    from contextpolicy.agent.current_limits import ContainerLimits, CurrentLimits
    from contextpolicy.agent.ledger import Entry, Ledger

log = logging.getLogger(__name__)


class LimitUndo:
    """One node's. `wanted` are the containers that policies still limit: their pods keep what these need."""

    def __init__(self, files: ControlFiles, ledger: Ledger, current: CurrentLimits) -> None:
        self._files, self._ledger, self._current = files, ledger, current

    def undo(self, entries: Mapping[Path, Entry], wanted: Collection[Path], *, leave_agreed: bool = False) -> Failures:
        """Undo what these entries of the ledger say; `leave_agreed`: put back only what others wrote.

        Files that hold another value by now are left alone. What can't be put back now stays in the ledger, to be tried
        again.
        """
        entries = {**self._too_small(wanted), **entries} if entries else entries
        originals = {p: entry for p, entry in entries.items() if entry.original is not None and not leave_agreed}
        failures = self._restore(originals) and self._restore(originals)
        for path in sorted(entries, key=lambda path: len(path.parts), reverse=True):
            if path not in originals:
                failures |= attempt(partial(self._put_back, path, entries[path], wanted), path.parent)
            failed = failures.get(path.parent)
            if failed.reason == GONE if failed else not self._is_too_small(path, entries[path], wanted):
                self._ledger.close(path)
        return failures | attempt(self._ledger.save, *(path.parent for path in entries))

    def _too_small(self, wanted: Collection[Path]) -> dict[Path, Entry]:
        """Pods that no policy limits any more, but which could not be put back so far."""
        limited = self._files.paths({*wanted, *map(pod_of, wanted)})
        name, entries = self._files.form.file, self._ledger.entries
        return {p: e for p, e in entries.items() if p.name == name and is_pod(p.parent) and p not in limited}

    def _is_too_small(self, path: Path, entry: Entry, wanted: Collection[Path]) -> bool:
        """Whether a pod keeps our limit because some of its containers are still to be undone."""
        with suppress(ActuationError):
            return self._is_shared(path.parent, wanted) and entry.wrote(self._files[path.parent].read())
        return False

    def _is_shared(self, group: Path, wanted: Collection[Path]) -> bool:
        """Whether it is a pod with containers that a policy wants, or that are still to be undone."""
        if not is_pod(group):
            return False
        open_entries = [path for path in self._ledger.entries if path.name == self._files.form.file]
        return group in {path.parent.parent for path in open_entries} | {pod_of(container) for container in wanted}

    def _restore(self, entries: Mapping[Path, Entry]) -> Failures:
        """Put back containers' originals; as for a plan, their pods only grow, or keep a limit of their own."""
        by_pod: dict[Path, ContainerLimits] = defaultdict(dict)
        failures: Failures = {}
        for path, entry in entries.items():
            group = path.parent
            try:
                now = self._current.of(group)
            except ActuationError as error:
                failures[group] = error
            else:
                if entry.knows(self._files[group].seen):
                    by_pod[pod_of(group)][group] = (now, self._files[group].amount(entry.original or ""))
        owned = {pod_of(path.parent) for path, entry in entries.items() if entry.in_owned}
        for step in limit_steps(self._current.pods(by_pod, owned, failures)):
            file = self._files[step.group]
            log.info("%s: restored %s", file.path, file.text(step.amount))
            failures |= attempt(partial(file.write, file.text(step.amount)), step.group)
        return failures

    def _put_back(self, path: Path, entry: Entry, wanted: Collection[Path]) -> None:
        """What others wrote; a pod that its containers' originals would not fit into any more gets their sum."""
        group, file = path.parent, self._files[path.parent]
        if not entry.wrote(file.read()):
            return
        fits = self._current.fits(group, file.amount(entry.theirs))
        if fits or not self._is_shared(group, wanted):
            text = self._theirs(file, entry) if fits else file.text(self._current.beside(group, ()))
            file.write(text)
            log.info("%s: restored %s", path, text)

    def _theirs(self, file: ControlFile, entry: Entry) -> str:
        """What others wrote; but no more than a limit of the pod's own, which its owner may have lowered since."""
        limit = file.amount(entry.theirs)
        most = self._current.of(pod_of(file.path.parent)) if entry.in_owned else None
        return entry.theirs if limit is None or most is None or limit <= most else file.text(most)
