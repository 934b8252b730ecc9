"""What was measured so far: a line of JSON for each run, written as it ends, so that a run can go on."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from tests.bench.enforcement.figures import Figures, Run
from tests.bench.enforcement.inputs import Queue
from tests.bench.enforcement.matrix import Cell, stand_in
from tests.bench.enforcement.stories import STORIES, tasks

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

Tuned = dict[str, int]


class OtherRunError(Exception):
    """The file is of a run with other options: its figures and these can't be compared."""


class Journal:
    """The runs by cell and block, and the weights that the search found by cell."""

    def __init__(self, file: Path, options: Mapping[str, Any], *, resume: bool) -> None:
        self._file = file
        self._runs: dict[Cell, dict[int, Run]] = {}
        self.tuned: dict[Cell, Tuned] = {}
        self.trials: dict[Cell, list[dict[str, Any]]] = {}
        if resume and file.exists():
            self._read(options)
        else:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(json.dumps(options) + "\n", encoding="utf-8")

    def add(self, cell: Cell, block: int, run: Run) -> None:
        """Keep a run; it is on disk when this returns."""
        self._append({"cell": cell.values(), "block": block, "run": run.values()})
        self._runs.setdefault(cell, {})[block] = run

    def add_tuned(self, cell: Cell, shares: Tuned, trials: list[dict[str, Any]]) -> None:
        """Keep what the search found, and how its finalists did."""
        self._append({"cell": cell.values(), "shares": shares, "trials": trials})
        self.tuned[cell], self.trials[cell] = shares, trials

    def has(self, cell: Cell, block: int) -> bool:
        """Whether that run was measured."""
        return block in self._runs.get(cell, {})

    def figures(self, cell: Cell) -> Figures | None:
        """All runs of a cell, or of the one that stands in for it; None without any."""
        runs = self._runs.get(cell) or self._runs.get(stand_in(cell))
        if not runs:
            return None
        by_name = {task.name: task for task in tasks(cell.load)}
        return Figures(STORIES[cell.story], by_name, [runs[block] for block in sorted(runs)])

    def runs(self) -> Sequence[tuple[Cell, int, Run]]:
        """All of them."""
        return [(cell, block, run) for cell, runs in self._runs.items() for block, run in sorted(runs.items())]

    def _append(self, entry: Mapping[str, Any]) -> None:
        with self._file.open("a", encoding="utf-8") as file:
            file.write(json.dumps(entry, separators=(",", ":")) + "\n")

    def _read(self, options: Mapping[str, Any]) -> None:
        text = self._file.read_text(encoding="utf-8")
        first, *lines = text.splitlines()
        if json.loads(first) != options:
            raise OtherRunError(f"{self._file} is of a run with {first}, not {json.dumps(options)}")
        if not text.endswith("\n"):  # the last line was cut off
            lines = lines[:-1]
            self._file.write_text("".join(f"{line}\n" for line in (first, *lines)), encoding="utf-8")
        for entry in map(json.loads, lines):
            cell = Cell(**{**entry["cell"], "queue": Queue(entry["cell"]["queue"])})
            if "run" in entry:
                self._runs.setdefault(cell, {})[entry["block"]] = Run(**entry["run"])
            else:
                self.tuned[cell], self.trials[cell] = entry["shares"], entry["trials"]
