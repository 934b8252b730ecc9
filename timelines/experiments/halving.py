"""Static weights tuned on the tuning stories: what the best user could have written without contexts. Pure, seeded.

Successive halving (Karnin, Koren, Somekh 2013; the inner loop of Hyperband): all sets of weights run the first story,
the best eight of them the second as well, and so on. The first four are what a user writes at once: equal weights,
those by priority, by need, and by need with the protected tasks above all; equal weights and those by priority are
never dropped, since a model or a lucky run may rank them too low. Then comes the fourth with each of its weights times
a factor of its own, drawn log-uniformly: drawn from all there are, nearly every set would leave some task next to
nothing. Last come two that a user writes who knows the stories, with sets drawn around each: next to nothing for the
tasks that are never critical nor protected, and for the others equal weights, or weights by their deadlines, as fixed
priorities are given (deadline monotonic: Leung, Whitehead 1982). A set is worth its worst context, where a context is
worth the lowest hit rate among its critical task and the protected ones, in steps of half a point; then the mean of
the contexts. The held-out stories take no part in it.
"""

from __future__ import annotations

import math
import random
from statistics import fmean
from typing import TYPE_CHECKING, NamedTuple

from timelines.experiments.blocks import SEED
from timelines.experiments.metrics import contexts
from timelines.experiments.stories import CRITICAL, PROTECTED

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from timelines.experiments.metrics import Run

AROUND_NEED, AROUND_KNOWN = 12, 7
"""How many sets are drawn around what the tasks need, and around each that a user writes who knows the stories."""
KEPT = (8, 4, 4)
"""How many go on after each story but the last."""
ALWAYS = 2
LEAST, MOST = 2, 4096
"""CPU shares, in the kubelet's unit."""
SPREAD = 4.0
"""By which factor a drawn weight is more or less than what the task needs, at most."""
STEPS = 200
"""Of a hit rate: half a point each."""

Weights = dict[str, int]


class Score(NamedTuple):
    """How good weights are; compares in this order."""

    worst: float
    contexts: float


class Tried(NamedTuple):
    """A set of weights, how good it was, and on how many stories."""

    stories: int
    score: Score
    weights: Weights


def candidates(
    priorities: Mapping[str, float], wanted: Mapping[str, float], deadlines: Mapping[str, float]
) -> list[Weights]:
    """What is tried: by `priorities` of the policy, by the cores that each task wants, and by deadlines in seconds."""
    numbers = random.Random(SEED)  # noqa: S311 - no secret
    by_need = _scaled({name: wanted.get(name, 0.0) for name in priorities})
    safe = {name: 1024 if name in PROTECTED else weight for name, weight in by_need.items()}
    matter = [name for name in priorities if name in {*CRITICAL.values(), *PROTECTED}]
    least = dict.fromkeys(priorities, LEAST)
    known = least | dict.fromkeys(matter, 1024)
    by_deadline = least | _scaled({name: 1 / deadlines[name] for name in matter if name in deadlines})
    return [
        *(dict.fromkeys(priorities, 256), _scaled(priorities), by_need, safe),
        *_drawn(safe, AROUND_NEED, numbers),
        *(known, *_drawn(known, AROUND_KNOWN, numbers)),
        *(by_deadline, *_drawn(by_deadline, AROUND_KNOWN, numbers)),
    ]


def halved(tries: Sequence[Weights], stories: Sequence[str], run: Callable[[int, Weights, str], Run]) -> list[Tried]:
    """Run them, fewer on each story; the best of those that ran all stories comes first. `run` gets a set's number."""
    runs: dict[int, list[Run]] = {number: [] for number in range(len(tries))}
    alive = list(runs)
    for place, story in enumerate(stories):
        for number in alive:
            runs[number].append(run(number, tries[number], story))
        if place < len(stories) - 1:
            ranked = sorted(alive, key=lambda number: score(runs[number]), reverse=True)
            alive = sorted({*ranked[: KEPT[min(place, len(KEPT) - 1)]], *range(min(ALWAYS, len(tries)))})
    found = [Tried(len(own), score(own), tries[number]) for number, own in runs.items()]
    return sorted(found, key=lambda one: one[:2], reverse=True)


def score(runs: Sequence[Run]) -> Score:
    """How good weights were in all of these runs."""
    rates: dict[str, list[float]] = {}
    for run in runs:
        for context, task in contexts(run.schedule).items():
            own = [name for name in (task, *PROTECTED) if name in run.schedule.inputs]
            hit = min(run.tally(name, context).hit for name in own)
            rates.setdefault(context, []).append(hit)
    means = [fmean(own) for own in rates.values()]
    return Score(math.floor(min(means) * STEPS + 1e-9) / STEPS, fmean(means))


def _scaled(sizes: Mapping[str, float]) -> Weights:
    """In proportion, the largest a core's shares."""
    most = max(sizes.values(), default=0.0) or 1.0
    return {name: max(LEAST, round(1024 * size / most)) for name, size in sizes.items()}


def _drawn(weights: Weights, count: int, numbers: random.Random) -> list[Weights]:
    return [{name: _around(weight, numbers) for name, weight in weights.items()} for _ in range(count)]


def _around(weight: int, numbers: random.Random) -> int:
    most = math.log(SPREAD)
    return min(MOST, max(LEAST, round(weight * math.exp(numbers.uniform(-most, most)))))
