"""Which steps of a run were measured so far, and what they found."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from tests.bench.json_lines import JsonLines, OtherRunError
from tests.bench.reaction.site import say

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path


class Journal:
    """One entry for each finished step."""

    def __init__(self, file: Path, options: dict[str, Any], steps: Sequence[str], *, resume: bool) -> None:
        self._lines, self._steps = JsonLines(file, options, resume=resume), list(steps)
        self._done: dict[str, Any] = {entry["step"]: entry["result"] for entry in self._lines.found}

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
            self._lines.add({"step": step, "result": result})
            self._done[step] = result
        return self._done[step]


def opened(file: Path, options: dict[str, Any], steps: Sequence[str], *, resume: bool) -> Journal:
    """The journal of a command; it ends if the run to go on with had other options."""
    try:
        return Journal(file, options, steps, resume=resume)
    except OtherRunError as error:
        sys.exit(f"{error}: leave --resume out to measure again")
