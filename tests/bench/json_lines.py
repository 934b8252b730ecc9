"""What was measured so far, on disk as it comes: a run that ends early loses nothing and can go on."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path


class OtherRunError(Exception):
    """The file is of a run with other options: its figures and these can't be compared."""


class JsonLines:
    """One line of JSON for each entry, after one with the options of the run; `found` are those of the run before."""

    def __init__(self, file: Path, options: Mapping[str, Any], *, resume: bool) -> None:
        self._file = file
        self._kept: str | None = None
        """What the file is to hold before anything is added, where its last line was cut off."""
        self.found: list[dict[str, Any]] = []
        if resume and file.exists():
            self._read(options)
        else:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(json.dumps(options) + "\n", encoding="utf-8")

    def add(self, entry: Mapping[str, Any]) -> None:
        """Keep an entry; it is on disk when this returns."""
        if self._kept is not None:
            self._file.write_text(self._kept, encoding="utf-8")
            self._kept = None
        with self._file.open("a", encoding="utf-8") as file:
            file.write(json.dumps(entry, separators=(",", ":")) + "\n")

    def _read(self, options: Mapping[str, Any]) -> None:
        text = self._file.read_text(encoding="utf-8")
        first, *lines = text.splitlines()
        if json.loads(first) != options:
            raise OtherRunError(f"{self._file} is of a run with {first}, not {json.dumps(options)}")
        if not text.endswith("\n"):  # the last line was cut off, or is being written
            lines = lines[:-1]
            self._kept = "".join(f"{line}\n" for line in (first, *lines))
        self.found = [json.loads(line) for line in lines]
