"""What was measured so far: an entry for each run, and for each search."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tests.bench.enforcement.figures import Figures, Run
from tests.bench.enforcement.inputs import Queue
from tests.bench.enforcement.matrix import Cell, stand_in
from tests.bench.enforcement.stories import STORIES, tasks
from tests.bench.json_lines import JsonLines

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

Tuned = dict[str, int]


class Journal:
    """The runs by cell and block, and the weights that the search found by cell."""

    def __init__(self, file: Path, options: Mapping[str, Any], *, resume: bool) -> None:
        self._lines = JsonLines(file, options, resume=resume)
        self._runs: dict[Cell, dict[int, Run]] = {}
        self._places: dict[Cell, dict[int, int]] = {}
        """Each run's place in the file."""
        self.tuned: dict[Cell, Tuned] = {}
        self.trials: dict[Cell, list[dict[str, Any]]] = {}
        for entry in self._lines.found:
            cell = Cell(**{**entry["cell"], "queue": Queue(entry["cell"]["queue"])})
            if "run" in entry:
                self._keep(cell, entry["block"], Run(**entry["run"]))
            else:
                self.tuned[cell], self.trials[cell] = entry["shares"], entry["trials"]

    def add(self, cell: Cell, block: int, run: Run) -> None:
        """Keep a run; it is on disk when this returns."""
        self._lines.add({"cell": cell.values(), "block": block, "run": run.values()})
        self._keep(cell, block, run)

    def add_tuned(self, cell: Cell, shares: Tuned, trials: list[dict[str, Any]]) -> None:
        """Keep what the search found, and how its finalists did."""
        self._lines.add({"cell": cell.values(), "shares": shares, "trials": trials})
        self.tuned[cell], self.trials[cell] = shares, trials

    def has(self, cell: Cell, block: int) -> bool:
        """Whether that run was measured."""
        return block in self._runs.get(cell, {})

    def figures(self, cell: Cell) -> Figures | None:
        """All runs of a cell, or of the one that stands in for it; None without any."""
        own = cell if cell in self._runs else stand_in(cell)
        runs = self._runs.get(own)
        if not runs:
            return None
        by_name, blocks = {task.name: task for task in tasks(cell.load)}, sorted(runs)
        places = [self._places[own][block] for block in blocks]
        return Figures(STORIES[cell.story], by_name, [runs[block] for block in blocks], blocks, places)

    def runs(self) -> Sequence[tuple[Cell, int, Run]]:
        """All of them."""
        return [(cell, block, run) for cell, runs in self._runs.items() for block, run in sorted(runs.items())]

    def _keep(self, cell: Cell, block: int, run: Run) -> None:
        self._runs.setdefault(cell, {})[block] = run
        self._places.setdefault(cell, {})[block] = sum(map(len, self._places.values()))
