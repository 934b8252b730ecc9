"""Which cells are measured, in which order, and which are left out and why. Pure.

`gated` is whether the modules drop the input of what their context suspends. "Off" compares all divisions without it,
"the same for all" with it, and "on" the product as a whole (contexts that gate) with static divisions that do not:
three comparisons of the same cells.
"""

from __future__ import annotations

import math
import random
from dataclasses import asdict, dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any

from tests.bench.enforcement.divisions import (
    ALONE,
    CONTEXTUAL,
    DEFAULT,
    PINNED,
    ROUND_ROBIN,
    STATIC,
    SUSPENSION,
    TUNED,
    WEIGHTS,
)
from tests.bench.enforcement.inputs import Inputs, Queue
from tests.bench.enforcement.policy import ATTEMPTS
from tests.bench.enforcement.stories import IMPORTANCE, STORIES, SUSPENDING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tests.bench.enforcement.stories import Script, Task

LIGHT, NEARLY, HEAVY = 0.7, 0.95, (1.3, 1.6)
LOADS = (LIGHT, NEARLY, *HEAVY)
CONFLICTING = 1.3
"""The load at which queues that lose nothing are tried."""
SEED = 20_261_123
BESIDE = 2
"""In how many blocks those cells are run that no goal needs."""


@dataclass(frozen=True, slots=True, order=True)
class Cell:
    """One thing to measure."""

    story: str
    load: float
    queue: Queue
    gated: bool
    division: str

    def __str__(self) -> str:
        gating = "gated" if self.gated else "ungated"
        return f"{self.story}, load {self.load:g}, {self.queue}, {gating}, {self.division}"

    def values(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)


def cells(loads: Iterable[float] = LOADS, *, attempts: bool = False) -> tuple[list[Cell], dict[Cell, str]]:
    """What to measure, and what not with the reason."""
    divisions = (*STATIC, *CONTEXTUAL, ALONE, *(ATTEMPTS if attempts else ()))
    measured, left_out = [], {}
    for story, load, queue, gated, name in product(STORIES, loads, Queue, (False, True), divisions):
        cell = Cell(story, load, queue, gated, name)
        reason = why_not(cell)
        if reason:
            left_out[cell] = reason
        else:
            measured.append(cell)
    return measured, left_out


def why_not(cell: Cell) -> str:
    """Why a cell makes no sense; empty if it does."""
    return next((reason for applies, reason in _RULES if applies(cell)), "")


def trained_on(cell: Cell) -> Cell:
    """The cell on which weights are tuned: queues that lose nothing use what was found for the newest input."""
    return replace(cell, queue=Queue.NEWEST)


def stand_in(cell: Cell) -> Cell:
    """The cell whose runs say what this one's would."""
    same = cell.story == SUSPENDING.name and not cell.gated and cell.division not in (*CONTEXTUAL, *ATTEMPTS)
    alone = cell.division == ALONE
    if same or alone:
        return Cell(
            IMPORTANCE.name, cell.load, Queue.NEWEST if alone else cell.queue, gated=False, division=cell.division
        )
    return cell


def for_goals(cell: Cell) -> bool:
    """Whether a goal compares it; the static divisions are among them where one of them might serve every context."""
    if cell.queue is not Queue.NEWEST or cell.load == NEARLY or cell.division in ATTEMPTS:
        return False
    if cell.division == WEIGHTS:
        return cell.gated or cell.story == IMPORTANCE.name
    if cell.story == IMPORTANCE.name:
        return cell.division in ((DEFAULT,) if cell.load == LIGHT else (*STATIC, ALONE))
    return cell.gated and cell.division in ((DEFAULT, SUSPENSION) if cell.load == LIGHT else STATIC)


def in_block(measured: Iterable[Cell], block: int) -> list[Cell]:
    """What is run in a block, in order: a seeded shuffle, another for each block."""
    order = sorted(cell for cell in measured if block < BESIDE or for_goals(cell))
    random.Random(SEED + block).shuffle(order)  # noqa: S311 - no secret
    return order


def taken(cell: Cell, task: Task, script: Script) -> Inputs:
    """What input a task takes in this cell."""
    if cell.division == ALONE:
        turns = enumerate(script.story.contexts)
        windows = [(n * script.seconds, (n + 1) * script.seconds) for n, one in turns if one.critical == task.name]
    else:
        windows = script.windows(task.name) if cell.gated else [(0.0, math.inf)]
    return Inputs(task.rate, script.count(task), cell.queue, windows, script.phase(task))


_RULES = (
    (
        lambda cell: cell.division == SUSPENSION and cell.story == IMPORTANCE.name,
        "no context suspends anything: the same as Linux' default",
    ),
    (
        lambda cell: stand_in(cell) != cell,
        "the same as in `importance` without gating: nothing here depends on contexts",
    ),
    (
        lambda cell: cell.story == IMPORTANCE.name and cell.gated,
        "no context suspends anything, so there is nothing to gate",
    ),
    (
        lambda cell: cell.queue is Queue.LOSSLESS and cell.load != CONFLICTING,
        f"queues that lose nothing are tried at load {CONFLICTING:g}",
    ),
    (
        lambda cell: cell.queue is Queue.LOSSLESS and cell.story == SUSPENDING.name and not cell.gated,
        "what waits while its task is suspended without gating is stale: tried with the newest input only",
    ),
    (
        lambda cell: cell.load == NEARLY and cell.story == SUSPENDING.name,
        "with one task suspended the others want about 0.7 of the node: see load 0.7",
    ),
    (
        lambda cell: cell.load == LIGHT and cell.story == SUSPENDING.name and not cell.gated,
        "suspension without gating is compared where processors are contested",
    ),
    (
        lambda cell: cell.load == LIGHT and cell.division in (TUNED, PINNED, ROUND_ROBIN),
        "everybody fits: a search has nothing to improve; the question here is whether contexts do harm",
    ),
    (lambda cell: cell.load <= NEARLY and cell.division == ALONE, "compared with under heavy load only"),
    (
        lambda cell: cell.division in ATTEMPTS and (cell.queue is Queue.LOSSLESS or cell.load == NEARLY),
        "attempts are made where a goal is set",
    ),
)
