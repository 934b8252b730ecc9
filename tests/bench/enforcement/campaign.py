"""All runs of the benchmark: the search for static weights, then block after block."""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import multiprocessing
import os
import platform
import sys
import time
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from tests.bench.enforcement.divisions import TUNED, division, static, weighted
from tests.bench.enforcement.figures import Figures
from tests.bench.enforcement.groups import Groups
from tests.bench.enforcement.inputs import Queue
from tests.bench.enforcement.journal import Journal
from tests.bench.enforcement.matrix import cells, in_block, trained_on
from tests.bench.enforcement.run import measure
from tests.bench.enforcement.search import Candidate, score, tune
from tests.bench.enforcement.stories import BASE, STORIES, Script, tasks

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tests.bench.enforcement.divisions import Division
    from tests.bench.enforcement.matrix import Cell


@dataclass(frozen=True, slots=True)
class Options:
    """What a run consists of; `seconds` is a context's length, `finalists` how many found weights are run."""

    loads: tuple[float, ...]
    seconds: float
    blocks: int
    finalists: int
    lossless: bool
    attempts: bool = False

    def replaced(self, blocks: int | None, *, attempts: bool) -> Options:
        """With what the command line says."""
        return replace(self, blocks=blocks or self.blocks, attempts=attempts)


class Campaign:
    """One run of the benchmark, or what is left of it."""

    def __init__(self, options: Options, file: Path, only: Sequence[str], *, resume: bool) -> None:
        self._options = options
        every, self.left_out = cells(options.loads, attempts=options.attempts)
        self.cells = [
            cell
            for cell in every
            if (options.lossless or cell.queue is Queue.NEWEST) and all(part in str(cell) for part in only)
        ]
        comparable = {name: value for name, value in asdict(options).items() if name not in ("blocks", "attempts")}
        self.journal = Journal(file, {**comparable, "loads": list(options.loads)}, resume=resume)

    def about(self) -> dict[str, Any]:
        """What has to be known of the figures."""
        machine = f"{platform.system()} {platform.release()}, {os.cpu_count()} processors"
        return {"machine": machine, **asdict(self._options)}

    def run(self) -> None:
        """Measure what is left."""
        candidates = self._search()
        with Groups(task.name for task in BASE) as groups:
            self._drop_realtime(groups)
            for cell, found in candidates.items():
                self._choose(cell, found, groups)
            left = [
                (block, cell)
                for block in range(self._options.blocks)
                for cell in in_block(self.cells, block)
                if not self.journal.has(cell, block)
            ]
            began = time.monotonic()
            for number, (block, cell) in enumerate(left):
                _say(f"{_left(began, number, len(left))} block {block + 1}: {cell}")
                measured = measure(cell, self._division(cell), tasks(cell.load), self._script(cell, block), groups)
                self.journal.add(cell, block, measured)

    def _search(self) -> dict[Cell, list[Candidate]]:
        """What the model thinks best, for each cell with tuned weights that has none yet."""
        tuned = dict.fromkeys(trained_on(cell) for cell in self.cells if cell.division == TUNED)
        wanted = [cell for cell in tuned if cell not in self.journal.tuned]
        if not wanted:
            return {}
        _say(f"searching static weights for {len(wanted)} cells")
        with multiprocessing.get_context("fork").Pool() as pool:
            found = pool.starmap(tune, [(cell, tasks(cell.load), self._script(cell)) for cell in wanted], chunksize=1)
            pool.close()
            pool.join()  # at its end it would kill its processes, which may hold a lock
        return dict(zip(wanted, found, strict=True))

    def _choose(self, cell: Cell, found: Sequence[Candidate], groups: Groups) -> None:
        """Run the best for real, and keep what is best there; the best of the simple sets comes last."""
        tried = [*found[: self._options.finalists], found[-1]]
        trials = []
        for number, candidate in enumerate(tried):
            _say(f"trying weights {number + 1} of {len(tried)}: {cell}")
            shares = dict(candidate.shares)
            own = static(TUNED, STORIES[cell.story], weighted(shares))
            run = measure(cell, own, tasks(cell.load), self._script(cell), groups)
            figures = Figures(STORIES[cell.story], {task.name: task for task in tasks(cell.load)}, [run])
            trials.append((score(figures), shares, candidate.score.worst, figures.critical()))
        _, best, *_ = max(trials, key=lambda trial: trial[0])
        kept = [{"shares": shares, "simulated": worst, "critical": hit} for _, shares, worst, hit in trials]
        self.journal.add_tuned(cell, best, kept)

    def _division(self, cell: Cell) -> Division:
        return division(cell.division, STORIES[cell.story], tasks(cell.load), self.journal.tuned.get(trained_on(cell)))

    def _script(self, cell: Cell, block: int = 0) -> Script:
        return Script(STORIES[cell.story], self._options.seconds, seed=block)

    def _drop_realtime(self, groups: Groups) -> None:
        """Where groups can't have realtime budgets, the cells that need them are left out."""
        if groups.realtime:
            return
        for cell in [cell for cell in self.cells if cell.division != TUNED and self._division(cell).needs_realtime]:
            self.cells.remove(cell)
            self.left_out[cell] = "this kernel gives groups no realtime budgets (cpu.rt_runtime_us)"


def _left(began: float, done: int, whole: int) -> str:
    """How far this is, and how long the rest may take."""
    if not done:
        return f"[0/{whole}]"
    seconds = (time.monotonic() - began) / done * (whole - done)
    return f"[{done}/{whole}, {seconds / 60:.0f} min left]"


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
