"""All runs of the benchmark: the search for static weights, then block after block."""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import multiprocessing
import os
import platform
import sys
import time
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from tests.bench.enforcement.divisions import TUNED, division, static, weighted
from tests.bench.enforcement.figures import Figures
from tests.bench.enforcement.groups import Groups
from tests.bench.enforcement.inputs import Queue
from tests.bench.enforcement.journal import Journal
from tests.bench.enforcement.matrix import cells, for_goals, in_block, trained_on
from tests.bench.enforcement.run import measure
from tests.bench.enforcement.search import tried, tune
from tests.bench.enforcement.stories import BASE, PROCESSORS, STORIES, Script, tasks

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from tests.bench.enforcement.divisions import Division
    from tests.bench.enforcement.figures import Run
    from tests.bench.enforcement.matrix import Cell
    from tests.bench.enforcement.search import Candidate

OTHERS = 0.02
"""The part of the machine that other work may take from a run."""
TRIES = 2


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
            left.sort(key=lambda one: not for_goals(one[1]))  # a campaign that ends early has what a verdict takes
            began = time.monotonic()
            for number, (block, cell) in enumerate(left):
                _say(f"{_left(began, number, len(left))} block {block + 1}: {cell}")
                run = partial(measure, cell, self._division(cell), tasks(cell.load), self._script(cell, block), groups)
                self.journal.add(cell, block, quieter(run, self._script(cell, block).end))

    def _search(self) -> dict[Cell, list[Candidate]]:
        """What the model thinks best, for each cell with tuned weights that has none yet."""
        tuned = dict.fromkeys(trained_on(cell) for cell in self.cells if cell.division == TUNED)
        wanted = [cell for cell in tuned if cell not in self.journal.tuned]
        if not wanted:
            return {}
        _say(f"searching static weights for {len(wanted)} cells")
        with multiprocessing.get_context("fork").Pool() as pool:
            tasked = [(cell, tasks(cell.load), self._script(cell), self._options.finalists) for cell in wanted]
            found = pool.starmap(tune, tasked, chunksize=1)
            pool.close()
            pool.join()  # at its end it would kill its processes, which may hold a lock
        return dict(zip(wanted, found, strict=True))

    def _choose(self, cell: Cell, found: Sequence[Candidate], groups: Groups) -> None:
        """Run the finalists for real, and keep what is best there."""
        by_name = {task.name: task for task in tasks(cell.load)}

        def run(shares: Mapping[str, int], block: int) -> Figures:
            _say(f"trying one of {len(found)} sets of weights in block {block + 1}: {cell}")
            own = static(TUNED, STORIES[cell.story], weighted(shares))
            measured = measure(cell, own, tasks(cell.load), self._script(cell, block), groups)
            return Figures(STORIES[cell.story], by_name, [measured])

        trials = tried(found, run)
        self.journal.add_tuned(cell, dict(trials[0].candidate.shares), [trial.values() for trial in trials])

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


def quieter(run: Callable[[], Run], seconds: float) -> Run:
    """Run it again while others take more than a fiftieth of the machine from it; the quieter of two tries."""
    tries: list[Run] = []
    while len(tries) < TRIES:
        tries.append(run())
        if tries[-1].foreign <= OTHERS * PROCESSORS * seconds:
            break
        _say(f"others took {tries[-1].foreign:.2f} CPU s")
    return min(tries, key=lambda one: one.foreign)


def _left(began: float, done: int, whole: int) -> str:
    """How far this is, and how long the rest may take."""
    if not done:
        return f"[0/{whole}]"
    seconds = (time.monotonic() - began) / done * (whole - done)
    return f"[{done}/{whole}, {seconds / 60:.0f} min left]"


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
