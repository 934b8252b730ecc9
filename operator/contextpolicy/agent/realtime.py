"""Realtime budgets (Eq. 2): a container's share of each period at realtime priority, at every level of the cgroups.

The kernel accounts for a budget on each processor separately. Several busy threads, or one that is not bound to a
processor, get it on each of them; the sum over the tasks stays within 95 % on each.

A suspended task leaves realtime: its threads go back to the fair scheduler, under the least CPU limit. Its share, a
thousandth, is less than a tick of the kernel's clock: after one tick at realtime priority it would stand still for
seconds. It keeps its budget meanwhile, because a group where a realtime thread is just starting can't have none
(EBUSY).
"""

from __future__ import annotations

import os
from functools import partial
from typing import TYPE_CHECKING

from contextpolicy.agent import threads
from contextpolicy.agent.child_groups import children
from contextpolicy.agent.failures import GONE, Failures, attempt
from contextpolicy.agent.node_orders import Manner
from contextpolicy.agent.steps import Step, budget_steps, budgets
from contextpolicy.errors import ActuationError
from contextpolicy.policy.spec import RealtimePolicy

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Container, Iterable, Mapping
    from pathlib import Path

    from contextpolicy.agent.cgroup_paths import CgroupPaths
    from contextpolicy.agent.control_files import ControlFiles
    from contextpolicy.agent.ledger import Entry, Ledger

_CLASSES = {RealtimePolicy.RR: os.SCHED_RR, RealtimePolicy.FIFO: os.SCHED_FIFO}
_ATTEMPTS = 5
"""A realtime thread may start between the last look at its group and the write that takes the group's budget away."""


class Realtime:
    """The realtime budgets of one node's containers; groups are the containers' cgroups.

    Nothing is raised: each method returns the groups where it failed.
    """

    def __init__(self, layout: CgroupPaths, files: ControlFiles, ledger: Ledger, priority: int) -> None:
        self._layout, self._files, self._ledger, self._priority = layout, files, ledger, priority
        self._manners: dict[str, Manner] = {}
        self._wanted: dict[str, dict[Path, int]] = {}
        self._others: dict[Path, dict[Path, int]] = {}

    def apply(
        self, policy: str, shares: Mapping[Path, int], manner: Manner, suspended: Collection[Path] = ()
    ) -> Failures:
        """Set all budgets of the policy, in thousandths of the period; containers that are not named leave realtime."""
        failures: Failures = {}
        for _ in range(_ATTEMPTS):
            try:
                return self._apply(policy, shares, manner, suspended)
            except ActuationError as error:  # a container has ended meanwhile: the next attempt leaves it out
                failures = dict.fromkeys(shares or (self._layout.top,), error)
        return failures

    def _apply(self, policy: str, shares: Mapping[Path, int], manner: Manner, suspended: Collection[Path]) -> Failures:
        # The kernel allows no realtime threads in a group without a budget (EBUSY, EPERM): so threads leave realtime
        # before their budget goes, and enter it only once they have one.
        failures = {group: error for group in shares if (error := self._absence(group)) is not None}
        self._wanted[policy] = {group: share for group, share in shares.items() if group not in failures}
        released, inherited = self._unclaimed(policy)
        before = self._manners.get(policy, manner)
        turned = self._wanted[policy] if before.policy is not manner.policy else ()
        self._manners[policy] = manner
        for group in {*released, *suspended, *turned}:
            failures |= attempt(partial(threads.make_ordinary, group, self._layout.version), group)
        failures |= self._divide(policy, inherited | self._merged() | released)
        for group in self._wanted[policy].keys() - set(suspended):
            failures = attempt(partial(self._enter, group, manner), group) | failures
        return self._close_settled() | failures

    def _enter(self, group: Path, manner: Manner) -> None:
        threads.make_realtime(group, self._layout.version, self._priority, _CLASSES[manner.policy])

    def release(self, policy: str) -> Failures:
        """Undo all budgets of the policy."""
        if policy not in self._wanted and not self._left_behind():
            return {}
        failures = self.apply(policy, {}, self._manners.get(policy, Manner()))
        self._wanted.pop(policy, None)
        self._manners.pop(policy, None)
        return failures

    def _unclaimed(self, policy: str) -> tuple[dict[Path, int], dict[Path, int]]:
        """Budgets for containers in the ledger that no plan names: the policy's own get what they had before.

        The others are from an earlier run and wait for their own policy's plan: they keep what they have.
        """
        entries = {path.parent: entry for path, entry in self._entries().items() if self._exists(path.parent)}
        wanted = self._merged()
        leaves = entries.keys() - {above for group in {*entries, *wanted} for above in group.parents} - wanted.keys()
        released = {g: self._amount(g, entries[g].theirs) for g in leaves if entries[g].policy == policy}
        return released, {g: self._now(g) for g in leaves - released.keys()}

    def _divide(self, policy: str, leaves: Mapping[Path, int]) -> Failures:
        """Write the budgets of leaves and all groups above them; the ledger is saved before the first write."""
        parents = {g for leaf in leaves for g in leaf.parents if g.is_relative_to(self._layout.top)}
        least = {parent: self._theirs(parent) for parent in parents}
        groups = budgets(leaves, self._layout.top, self._others_of(parents, {*parents, *leaves}), least)
        failures: Failures = {}
        for leaf in self._wanted[policy]:
            failures |= attempt(partial(self._set_period, policy, leaf, self._manners[policy].period), leaf)
        steps = budget_steps({group: self._now(group) for group in groups}, groups)
        for step in steps:
            file = self._files[step.group]
            self._ledger.intend(file.path, policy, now=file.read(), ours=self._text(step))
        # What puts back what was there before needs no new line in the journal.
        unsaved = attempt(self._ledger.save, *(step.group for step in steps if not self._restores(step)))
        for step in steps:
            if step.group not in unsaved:
                failures |= attempt(partial(self._write, step), step.group)
        return failures | unsaved

    def _set_period(self, policy: str, group: Path, period: int) -> None:
        """Set the period, at no instant with a larger fraction of the processor: the budget falls before the period."""
        file = self._files[group]
        if file.period == period:
            return
        now, shorter = self._now(group), file.scaled(file.read(), period)
        if file.period_path is None:  # version 2: one write changes budget and period together
            file.set_period(period)
            if now:
                self._write_ahead(file.path, policy, file.read(), shorter, lambda: file.write(shorter))
            return
        if now and period < file.period:
            self._write_ahead(file.path, policy, file.read(), shorter, lambda: file.write(shorter))
        self._write_ahead(file.period_path, policy, str(file.period), str(period), lambda: file.set_period(period))

    def _write_ahead(self, path: Path, policy: str, now: str, ours: str, write: Callable[[], None]) -> None:
        """Save the ledger, then write."""
        self._ledger.intend(path, policy, now=now, ours=ours)
        self._ledger.save()
        write()

    def _text(self, step: Step) -> str:
        """The text of a step; an amount that was there before comes back as exactly the same text."""
        file = self._files[step.group]
        entry = self._ledger.entries.get(file.path)
        before = entry is not None and file.amount(entry.theirs) == step.amount
        return entry.theirs if entry is not None and before else file.text(step.amount)

    def _restores(self, step: Step) -> bool:
        return self._text(step) == self._ledger.entries[step.group / self._files.form.file].theirs

    def _write(self, step: Step) -> None:
        file, text = self._files[step.group], self._text(step)
        for _ in range(_ATTEMPTS - 1):
            try:
                file.write(text)
            except ActuationError as error:
                if error.reason != "Busy":
                    raise
                # A realtime thread has started meanwhile, and the kernel won't take its group's budget away.
                threads.make_ordinary(step.group, self._layout.version)
            else:
                return
        file.write(text)

    def _others_of(self, parents: Iterable[Path], ours: Container[Path]) -> dict[Path, int]:
        """The sum of foreign children's budgets, by parent; read once: only the agent gives pods realtime budgets."""
        for parent in parents:
            if parent not in self._others:
                self._others[parent] = {c: self._now(c) for c in children(parent) if self._foreign(c)}
        return {p: sum(a for child, a in self._others[p].items() if child not in ours) for p in parents}

    def _theirs(self, group: Path) -> int:
        """The budget that the group had before us."""
        entry = self._ledger.entries.get(group / self._files.form.file)
        return self._now(group) if entry is None else self._amount(group, entry.theirs)

    def _foreign(self, group: Path) -> bool:
        return group / self._files.form.file not in self._ledger.entries and self._exists(group)

    def _now(self, group: Path) -> int:
        return self._amount(group, self._files[group].read())

    def _amount(self, group: Path, text: str) -> int:
        return self._files[group].amount(text) or 0

    def _exists(self, group: Path) -> bool:
        """Whether the group can be read; if it is gone, its entries are closed, as nothing is left to undo."""
        error = self._absence(group)
        if error is not None and error.reason == GONE:
            for file in (self._files.form.file, self._files.form.period_file or self._files.form.file):
                self._ledger.close(group / file)
        return error is None

    def _absence(self, group: Path) -> ActuationError | None:
        """Why the group can't be read, if so."""
        try:
            self._now(group)
        except ActuationError as error:
            return error
        return None if group.is_dir() else ActuationError(GONE, f"{group}: cgroup was removed", retriable=False)

    def _merged(self) -> dict[Path, int]:
        return {group: share for shares in self._wanted.values() for group, share in shares.items()}

    def _entries(self) -> dict[Path, Entry]:
        return {path: e for path, e in self._ledger.entries.items() if path.name == self._files.form.file}

    def _left_behind(self) -> bool:
        """Whether the ledger has anything of ours: a budget, or a period of an earlier run."""
        names = {self._files.form.file, self._files.form.period_file}
        return any(path.name in names for path in self._ledger.entries)

    def _close_settled(self) -> Failures:
        """Close the entries of groups that are as they were, and the files of groups without an entry."""
        entries = self._entries()
        for path, entry in entries.items():
            if self._exists(path.parent) and self._files[path.parent].read() == entry.theirs:
                self._ledger.close(path)
        settled = {path.parent for path in entries.keys() - self._ledger.entries.keys()}
        failures = self._put_periods_back() | attempt(self._ledger.save, *settled)
        self._files.keep({path.parent for path in self._entries()})
        return failures

    def _put_periods_back(self) -> Failures:
        """Restore the periods of groups without a budget from us; an earlier run may have ended before it wrote any."""
        failures: Failures = {}
        budgets = {path.parent for path in self._entries()}
        periods = {p: e for p, e in self._ledger.entries.items() if p.name == self._files.form.period_file}
        for path, entry in periods.items():
            if path.parent not in budgets:
                failures |= attempt(partial(self._put_period_back, path, entry), path.parent)
        return failures

    def _put_period_back(self, path: Path, entry: Entry) -> None:
        if self._exists(path.parent):
            self._files[path.parent].set_period(int(entry.theirs))
            self._ledger.close(path)
