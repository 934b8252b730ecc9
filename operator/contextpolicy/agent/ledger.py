"""What the agent wrote and what was there before, saved before every write, so that a restarted agent can undo it.

The file is a journal: a line for each change, appended with one system call (replacing the whole file costs 50 times
that), and emptied when nothing is left to undo. A reboot removes the cgroups and the journal (in /run) together.
"""

from __future__ import annotations

import errno
import json
import logging
import os
import re
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from contextpolicy.errors import ActuationError

log = logging.getLogger(__name__)

LONGEST = 1 << 20
"""Size of the journal in bytes above which it is rewritten without its outdated lines."""

_AMOUNTS = (
    ("_period_us", re.compile(r"[1-9][0-9]{0,18}")),
    ("_us", re.compile(r"-?[0-9]{1,19}( [1-9][0-9]{0,18})?")),
    (".max", re.compile(r"(max|[0-9]{1,19})( [1-9][0-9]{0,18})?")),
    ("", re.compile(r"[0-9]{1,19}")),
)
"""The ends of names, and the texts of such files: periods, bandwidths of version 1 and 2, weights."""


@dataclass(slots=True)
class Entry:
    """One file: `theirs` is what anybody else last wrote, `ours` what we last wrote, both as the file's text.

    `earlier` are values that we wrote before, which a resize under way may still write. A `held` file is ours alone to
    write. `inherited` entries are from an earlier run, which may have ended before its write, or their last write
    failed: the file then holds an earlier value. `overtook` says that the watch has yet to report a write before ours,
    which is not ours confirmed. In both cases only the next plan shows whether a resize has confirmed it since.
    `original` is what the file held before any policy, where the plan says so. Such an entry stays open when the API
    agrees: `theirs` is then the same as `ours`. `in_owned`: the container's pod has a limit of its own, which is not
    written, also to undo.
    """

    policy: str
    theirs: str
    ours: str
    held: bool = False
    inherited: bool = False
    overtook: bool = False
    earlier: set[str] = field(default_factory=set)
    original: str | None = None
    in_owned: bool = False

    @property
    def agreed(self) -> bool:
        """Whether the API has what we want."""
        return self.theirs == self.ours and not self.held

    def knows(self, text: str) -> bool:
        """Whether a file that holds `text` holds what the API or we last wrote, not a later foreign write."""
        return text in (self.theirs, self.ours, *self.earlier)

    def wrote(self, text: str) -> bool:
        """Whether a file that holds `text` holds our value, not what was there before."""
        return text != self.theirs and (text == self.ours or (self.inherited and text in self.earlier))


class Ledger:
    """All entries, by file."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self.entries: dict[Path, Entry] = {}
        self.is_saved = True
        """Whether the last `save` succeeded."""
        self.is_damaged = False
        """Whether `load` found an unreadable line that was not just cut short: what it had to undo is unknown."""
        self._changed: set[Path] = set()
        self._journal: int | None = None

    def load(self) -> None:
        """Load the entries of an earlier run; unreadable lines, such as one cut short, are logged and left out.

        The file is then rewritten: with such a line it would never be empty again.
        """
        try:
            content = self._file.read_bytes()
        except FileNotFoundError:
            return
        taken = [self._take(line) for line in content.splitlines()]
        # What was being appended when the agent was killed was not done yet.
        self.is_damaged = not all(taken if content.endswith(b"\n") else taken[:-1])
        if not all(taken):
            try:
                self._begin_anew()
            except OSError as error:
                log.warning("%s can't be rewritten: %s", self._file, error.strerror)

    def _take(self, line: bytes) -> bool:
        try:
            self._replay(*json.loads(line))
        except (ValueError, TypeError, AttributeError, RecursionError) as error:
            log.warning("%s: unreadable line: %s", self._file, error)
            return False
        return True

    def of(self, policy: str) -> dict[Path, Entry]:
        """The policy's entries."""
        return {path: entry for path, entry in self.entries.items() if entry.policy == policy}

    def intend(  # noqa: PLR0913 - all that an entry says
        self,
        path: Path,
        policy: str,
        *,
        now: str,
        ours: str,
        held: bool = False,
        original: str | None = None,
        in_owned: bool = False,
    ) -> None:
        """We are about to write `ours` over `now`; the caller must `save` before it does."""
        entry = self.entries.get(path)
        self._changed.add(path)
        if entry is None:
            self.entries[path] = Entry(policy, now, ours, held, original=original, in_owned=in_owned)
            return
        if entry.inherited and now not in {entry.ours, *entry.earlier}:
            entry.theirs = now  # another process wrote while no agent ran
        if held:
            entry.earlier = {now, entry.ours}
        elif entry.ours != ours:
            entry.earlier.add(entry.ours)
        entry.policy, entry.ours, entry.held, entry.original, entry.in_owned = policy, ours, held, original, in_owned
        entry.inherited = entry.overtook = False

    def remember(  # noqa: PLR0913 - all that an entry says
        self, path: Path, policy: str, *, now: str, original: str, held: bool = False, in_owned: bool = False
    ) -> None:
        """The policy wants what the file holds already; `original` is what to put back in the end."""
        entry, said = self.entries.get(path), (policy, held, original, in_owned)
        if entry is None and now != original:
            self.entries[path] = Entry(policy, now, now, held, original=original, in_owned=in_owned)
            self._changed.add(path)
        elif entry is not None and (entry.policy, entry.held, entry.original, entry.in_owned) != said:
            entry.policy, entry.held, entry.original, entry.in_owned = said
            self._changed.add(path)

    def agree(self, path: Path, text: str) -> None:
        """The API has `text`, which the policy wants and the file holds: only the original is left to put back."""
        entry = self.entries[path]
        if entry.original in (None, text):
            self.close(path)
            return
        entry.theirs, entry.ours, entry.earlier = text, text, set()
        entry.inherited = entry.overtook = False
        self._changed.add(path)

    def retract(self, path: Path) -> None:
        """What we intended was not written: the file holds what it held before, maybe an earlier value of ours."""
        entry = self.entries[path]
        if entry.earlier:
            entry.inherited = True
        else:
            self.close(path)

    def overtake(self, path: Path, theirs: str) -> None:
        """What we intend replaces `theirs`, a foreign write that the watch has yet to report."""
        entry = self.entries[path]
        entry.theirs, entry.overtook = theirs, True

    def hear(self, path: Path, theirs: str) -> None:
        """Another process wrote `theirs`, and the entry stays open."""
        if self.entries[path].theirs != theirs:
            self.entries[path].theirs = theirs
            self._changed.add(path)

    def close(self, path: Path) -> None:
        """The file has nothing to undo."""
        if self.entries.pop(path, None) is not None:
            self._changed.add(path)

    def save(self) -> None:
        """Append all changes to the journal.

        ActuationError `Unsaved` when that fails: what was intended must not be written. The next call saves it all.
        """
        if not self._changed:
            return
        try:
            self._append()
        except OSError as error:
            self.is_saved = False
            self._leave_journal()
            raise ActuationError("Unsaved", f"{self._file}: {error.strerror}", retriable=True) from error
        self._changed.clear()
        self.is_saved = True

    def _append(self) -> None:
        journal = self._journal
        if journal is None or os.fstat(journal).st_size > LONGEST:
            self._begin_anew()
        elif self.entries:
            # No fsync: the journal has to outlive this process, not the machine.
            lines = b"".join(self._line(path) for path in self._changed)
            if os.write(journal, lines) < len(lines):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        else:
            os.ftruncate(journal, 0)

    def _begin_anew(self) -> None:
        self._file.parent.mkdir(parents=True, exist_ok=True)
        temporary = self._file.with_suffix(".new")
        temporary.write_bytes(b"".join(self._line(path) for path in self.entries))
        temporary.replace(self._file)
        self._leave_journal()
        self._journal = os.open(self._file, os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC)

    def _leave_journal(self) -> None:
        """Rewrite the file with the next change: its last line may have been cut short."""
        if self._journal is not None:
            os.close(self._journal)
        self._journal = None

    def _line(self, path: Path) -> bytes:
        entry = self.entries.get(path)
        content = entry and (
            entry.policy,
            entry.theirs,
            entry.ours,
            entry.held,
            sorted(entry.earlier),
            entry.original,
            entry.in_owned,
        )
        return msgspec.json.encode((str(path), content)) + b"\n"

    def _replay(self, path: str, entry: tuple[str, str, str, bool, list[str], str | None, bool] | None) -> None:
        if not path.startswith("/") or b"\0" in os.fsencode(path):
            raise ValueError(f"{path!r}: expected an absolute path")
        if entry is None:
            self.entries.pop(Path(path), None)
        else:
            policy, theirs, ours, held, earlier, original, in_owned = entry
            form = next(form for end, form in _AMOUNTS if path.endswith(end))
            inherited = Entry(str(policy), _amount(theirs, form), _amount(ours, form), held is True, inherited=True)
            inherited.in_owned = in_owned is True
            inherited.earlier = {_amount(text, form) for text in earlier}
            inherited.original = None if original is None else _amount(original, form)
            self.entries[Path(path)] = inherited


def _amount(text: str, form: re.Pattern[str]) -> str:
    if not form.fullmatch(text):
        raise ValueError(f"{text!r}: expected the content of a control file, such as 50000 or max 100000")
    return text
