"""How far a figure can be trusted: blocks that several cells have in common, drawn again and again. Pure, and seeded.

A bootstrap: as many blocks as there are, drawn with replacement, thousands of times. A block's runs of all compared
cells are drawn together, as what disturbs a machine for a while disturbs them all; so only cells are compared whose
runs of each block were measured one after the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from tests.bench.enforcement.figures import TENTHS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from tests.bench.enforcement.figures import Figures

RESAMPLES = 10_000
SEED = 20_261_126
COVERAGE = 0.95


@dataclass(frozen=True, slots=True)
class Interval:
    """A figure over all blocks, and the least and the most of it that 95 % of the drawn sets have between them."""

    whole: float
    least: float
    most: float


class Drawn:
    """One cell's figures: first over all blocks, then over each drawn set of them."""

    def __init__(self, figures: Figures, blocks: Sequence[int], counts: NDArray[np.int64]) -> None:
        """`counts` says how often each set has each of these blocks."""
        self.figures = figures.only(blocks)
        self._counts = counts

    def hit(self, task: str, contexts: Iterable[str] | None = None) -> NDArray[np.float64]:
        """See `Figures.hit`."""
        done = [self.figures.done(task, run, contexts) for run in self.figures.runs]
        hits, due = (self._counts @ np.array([one[place] for one in done]) for place in (0, 1))
        rates: NDArray[np.float64] = np.divide(hits, due, out=np.full(len(due), np.nan), where=due > 0)
        return rates

    def quantile(self, task: str, part: float) -> NDArray[np.float64]:
        """See `Figures.quantile`, in seconds."""
        found = [np.sort(np.array(self.figures.times(task, run), float))[::-1] for run in self.figures.runs]
        whole = self._counts @ np.array([len(one) for one in found])
        if not whole.all():
            return np.where(whole > 0, np.inf, np.nan)  # some block has none: nothing is claimed of such a cell
        above = whole - np.ceil(part * whole).astype(int)
        # Of each block no more can count than the slowest of the largest set.
        slowest = [one[: above.max() + 1] for one in found]
        times = np.concatenate(slowest)
        of_block = np.repeat(np.arange(len(slowest)), [len(one) for one in slowest])
        order = np.argsort(-times, kind="stable")
        times, of_block = times[order], of_block[order]
        answers = np.empty(len(whole))
        for begin in range(0, len(whole), _AT_ONCE):
            some = slice(begin, begin + _AT_ONCE)
            passed = np.cumsum(self._counts[some][:, of_block], axis=1) > above[some, None]
            answers[some] = times[np.argmax(passed, axis=1)]
        return answers / TENTHS

    def work(self) -> NDArray[np.float64]:
        """See `Figures.work`."""
        each = np.array([sum(run.work.values()) for run in self.figures.runs])
        order = np.argsort(each)
        passed = np.cumsum(self._counts[:, order], axis=1)
        number = len(each)
        middle = [each[order][np.argmax(passed > place, axis=1)] for place in ((number - 1) // 2, number // 2)]
        medians: NDArray[np.float64] = (middle[0] + middle[1]) / 2
        return medians


_AT_ONCE = 1000
"""Sets for which a quantile is sought at once."""


class Paired:
    """What several cells have in common."""

    def __init__(self, *cells: Figures, resamples: int = RESAMPLES) -> None:
        self._cells, self._resamples = cells, resamples
        self.blocks = sorted(set.intersection(*(set(one.blocks) for one in cells)))

    @property
    def interleaved(self) -> bool:
        """Whether no run of another block lies between those of one block, as far as these cells are concerned."""
        runs = {place: block for one in self._cells for block, place in zip(one.blocks, one.places, strict=True)}
        order = [runs[place] for place in sorted(runs) if runs[place] in self.blocks]
        changes = sum(one != other for one, other in pairwise(order))
        return changes == len(self.blocks) - 1

    @cached_property
    def drawn(self) -> list[Drawn]:
        """The cells, in the order given, all over the same sets of blocks."""
        number = len(self.blocks)
        even = np.full(number, 1 / number)
        sets = np.random.default_rng(SEED).multinomial(number, even, self._resamples)
        counts = np.concatenate([np.ones((1, number), np.int64), sets])
        return [Drawn(one, self.blocks, counts) for one in self._cells]


def interval(drawn: NDArray[np.float64]) -> Interval:
    """Of a figure over all blocks, which comes first, and over the sets; what is not a number is the least there is."""
    known = np.where(np.isnan(drawn), -np.inf, drawn)
    ordered = np.sort(known[1:])
    outside = round((1 - COVERAGE) / 2 * len(ordered))
    return Interval(float(known[0]), float(ordered[outside]), float(ordered[len(ordered) - 1 - outside]))
