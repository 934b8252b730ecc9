"""What was measured so far, on disk as it comes: a run that ends early loses nothing and can go on."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from tests.bench.reaction.site import say

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path


class OtherRunError(Exception):
    """The journal is of a run with other options: its figures and these would not be comparable."""


class Journal:
    """One line of JSON for each finished step, after one that tells the options of the run."""

    def __init__(self, file: Path, options: dict[str, Any], steps: Sequence[str], *, resume: bool) -> None:
        self._file, self._steps = file, list(steps)
        self._done: dict[str, Any] = self._read(options) if resume and file.exists() else {}
        file.parent.mkdir(parents=True, exist_ok=True)
        kept = [{"step": step, "result": result} for step, result in self._done.items()]
        file.write_text("".join(json.dumps(line) + "\n" for line in (options, *kept)), encoding="utf-8")

    def left(self) -> list[str]:
        """The steps that are still to be measured, in order."""
        return self.left_of(self._steps)

    def left_of(self, steps: Iterable[str]) -> list[str]:
        """Those of some steps that are still to be measured."""
        return [step for step in steps if step not in self._done]

    def found(self, step: str) -> Any:
        """What the step measured; an empty list while it is left."""
        return self._done.get(step, [])

    def once(self, step: str, measure: Callable[[], Any]) -> Any:
        """What the step measured, in this run or before; it is on disk when this returns."""
        if step not in self._done:
            say(f"{step}; {len(self.left())} of {len(self._steps)} steps left")
            result = measure()
            with self._file.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"step": step, "result": result}) + "\n")
            self._done[step] = result
        return self._done[step]

    def _read(self, options: dict[str, Any]) -> dict[str, Any]:
        """The finished steps; the last line may be half written."""
        first, *lines = self._file.read_text(encoding="utf-8").splitlines()
        if json.loads(first) != options:
            raise OtherRunError(f"{self._file} is of a run with {first}, not {json.dumps(options)}")
        return {entry["step"]: entry["result"] for entry in map(_entry, lines) if entry}


def _entry(line: str) -> dict[str, Any] | None:
    try:
        found: dict[str, Any] = json.loads(line)
    except ValueError:
        return None
    return found
