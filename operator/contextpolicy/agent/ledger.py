"""What the agent wrote and what was there before: on disk ahead of every write, so that a killed agent can undo.

A reboot takes the cgroups and this file's directory (/run) away together.
"""

from __future__ import annotations

import json
import logging
from dataclasses import dataclass, field
from pathlib import Path

log = logging.getLogger(__name__)


@dataclass(slots=True)
class Entry:
    """One file: `theirs` is what anybody else last wrote, `ours` what we did; as the file's own text.

    `earlier` is what we wrote before and a resize under way may still bring. A `held` file is ours alone to write.
    `inherited` entries are from a former life: whether a resize has agreed since is for the next plan to tell.
    """

    policy: str
    theirs: str
    ours: str
    held: bool = False
    inherited: bool = False
    earlier: set[str] = field(default_factory=set)


class Ledger:
    """All entries by file."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self.entries: dict[Path, Entry] = {}
        self._saved = ""

    def load(self) -> None:
        """Take over from a former life; a damaged file is as none."""
        try:
            saved = json.loads(self._file.read_text(encoding="utf-8"))
            for path, (policy, theirs, ours, held) in saved.items():
                self.entries[Path(path)] = Entry(str(policy), str(theirs), str(ours), held is True, inherited=True)
        except FileNotFoundError:
            return
        except (OSError, ValueError, TypeError, AttributeError) as error:
            log.warning("%s: what a former agent wrote can't be known: %s", self._file, error)

    def of(self, policy: str) -> dict[Path, Entry]:
        """The policy's entries."""
        return {path: entry for path, entry in self.entries.items() if entry.policy == policy}

    def intend(self, path: Path, policy: str, *, now: str, ours: str, held: bool = False) -> None:
        """We are about to write `ours` over `now`; nothing is written before `save`."""
        entry = self.entries.get(path)
        if entry is None:
            self.entries[path] = Entry(policy, now, ours, held)
            return
        if entry.ours != ours:
            entry.earlier.add(entry.ours)
        entry.policy, entry.ours, entry.held, entry.inherited = policy, ours, held, False

    def close(self, path: Path) -> None:
        """There is nothing to undo in this file."""
        self.entries.pop(path, None)

    def save(self) -> None:
        """Bring it to disk, whole or not at all."""
        saved = json.dumps({str(path): (e.policy, e.theirs, e.ours, e.held) for path, e in self.entries.items()})
        if saved == self._saved:
            return
        temporary = self._file.with_suffix(".new")
        temporary.write_text(saved, encoding="utf-8")
        temporary.replace(self._file)
        self._saved = saved
