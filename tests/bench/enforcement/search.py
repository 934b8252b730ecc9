"""Static weights tuned for a story: what the best user could have written without contexts. Pure, and seeded.

Method, fixed before any figure: 240 sets of weights are simulated on the evaluated story itself, at its load, queue
and gating, with the phases of two blocks. The first are what a user might write: equal, by priority, by need, each
context's own weights, and the critical and protected tasks above the rest. Then random sets up to half of the budget,
each weight drawn log-uniformly from 2 to 4096 shares; the rest are changes of one of the best eight so far, each weight
times e to the power of a normal deviate whose standard deviation falls from 1 to 0.2. A context is worth the lowest hit
rate among its critical task and the protected ones: weights that starve navigation serve nobody. Better is, in this
order: the worst context, in steps of half a point; the mean of the contexts; the mean of all tasks. The model is no
good prophet: so besides the best four, equal weights and those by priority are always run for real, each twice, with
the phases of the same two blocks. What is best in the worse of its runs, by the same comparison, is the tuned division.
"""

from __future__ import annotations

import math
import random
from dataclasses import replace
from statistics import fmean
from typing import TYPE_CHECKING, Any, NamedTuple

from tests.bench.enforcement.divisions import LEAST_SHARES, kubelet_shares, shares
from tests.bench.enforcement.figures import Figures, Run
from tests.bench.enforcement.matrix import SEED, taken
from tests.bench.enforcement.policy import WEIGHTED
from tests.bench.enforcement.simulator import Simulated, simulate
from tests.bench.enforcement.stories import PROCESSORS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from tests.bench.enforcement.matrix import Cell
    from tests.bench.enforcement.stories import Script, Task

BUDGET = 240
KEPT = 8
SEEDS = (0, 1)
"""The blocks whose phases are simulated, and run."""
FINALISTS = 4
UNTUNED = 2
"""How many of the simple sets are always run: equal weights and those by priority."""
MOST_SHARES = 4096
WIDEST, NARROWEST = 1.0, 0.2
STEPS = 200
"""Of a hit rate: half a point each."""


class Score(NamedTuple):
    """How good weights are; compares in this order."""

    worst: float
    contexts: float
    tasks: float


class Candidate(NamedTuple):
    """Weights in shares, and how good they are."""

    score: Score
    shares: tuple[tuple[str, int], ...]


class Trial(NamedTuple):
    """What a finalist did: the score of the worse of its runs, and the figures of each."""

    score: Score
    candidate: Candidate
    runs: Sequence[Figures]

    def values(self) -> dict[str, Any]:
        """As plain data; `critical` has each context's worse run."""
        hits = [figures.critical() for figures in self.runs]
        return {
            "shares": dict(self.candidate.shares),
            "simulated": self.candidate.score.worst,
            "runs": len(self.runs),
            "critical": {context: min(hit[context] for hit in hits) for context in hits[0]},
        }


def tune(
    cell: Cell, tasks: Sequence[Task], script: Script, finalists: int = FINALISTS, budget: int = BUDGET
) -> list[Candidate]:
    """What to run for real: the best sets of weights, the best first, and then those that nobody tuned."""
    numbers = random.Random(SEED)  # noqa: S311 - no secret
    found = [_judge(weights, cell, tasks, script) for weights in simple(tasks, script)]
    untuned = found[:UNTUNED]
    while len(found) < budget:
        if len(found) < budget // 2:
            weights = {task.name: _anything(numbers) for task in tasks}
        else:
            parent = dict(numbers.choice(sorted(found, reverse=True)[:KEPT]).shares)
            weights = _changed(parent, 2 - 2 * len(found) / budget, numbers)
        found.append(_judge(weights, cell, tasks, script))
    best = sorted(set(found), reverse=True)[:finalists]
    return list(dict.fromkeys((*best, *untuned)))


def tried(candidates: Sequence[Candidate], run: Callable[[Mapping[str, int], int], Figures]) -> list[Trial]:
    """Run each with these weights in each of the blocks; the best in its worse run comes first."""
    trials = []
    for candidate in candidates:
        runs = [run(dict(candidate.shares), block) for block in SEEDS]
        trials.append(Trial(min(map(score, runs)), candidate, runs))
    return sorted(trials, key=lambda trial: trial.score, reverse=True)


def simple(tasks: Sequence[Task], script: Script) -> list[dict[str, int]]:
    """What a user might write without a search: first equal weights, and those by priority."""
    by_priority = sum(task.priority for task in tasks)
    critical = {context.critical for context in script.story.contexts}
    return [
        {task.name: kubelet_shares(PROCESSORS * 1000 // len(tasks)) for task in tasks},
        {task.name: kubelet_shares(round(PROCESSORS * 1000 * task.priority / by_priority)) for task in tasks},
        {task.name: kubelet_shares(round(task.wants * 1000)) for task in tasks},
        {task.name: 1024 if task.name in critical or task.protected else 16 for task in tasks},
        *(
            {name: kubelet_shares(share) for name, share in shares(tasks, context, WEIGHTED).items()}
            for context in script.story.contexts
        ),
    ]


def score(figures: Figures) -> Score:
    """How good a run was."""
    protected = [task.name for task in figures.tasks.values() if task.protected]
    contexts = [
        min(figures.hit(task, [context.name]) for task in (context.critical, *protected))
        for context in figures.story.contexts
    ]
    tasks = [figures.hit(task) for task in figures.tasks]
    return Score(math.floor(min(contexts) * STEPS + 1e-9) / STEPS, fmean(contexts), fmean(tasks))


def simulated(weights: Mapping[str, float], cell: Cell, tasks: Sequence[Task], script: Script) -> Run:
    """What the model expects of static weights."""
    models = {task.name: Simulated(taken(cell, task, script), task.cost, weights[task.name]) for task in tasks}
    finished = simulate(models, script.end)
    done = {t.name: t.cost * sum(not math.isnan(time) for time in finished[t.name]) for t in tasks}
    return Run.of(tasks, script, finished, done, ())


def _judge(weights: Mapping[str, int], cell: Cell, tasks: Sequence[Task], script: Script) -> Candidate:
    runs = [simulated(weights, cell, tasks, replace(script, seed=seed)) for seed in SEEDS]
    figures = Figures(script.story, {task.name: task for task in tasks}, runs)
    return Candidate(score(figures), tuple(sorted(weights.items())))


def _anything(numbers: random.Random) -> int:
    return round(math.exp(numbers.uniform(math.log(LEAST_SHARES), math.log(MOST_SHARES))))


def _changed(weights: Mapping[str, int], left: float, numbers: random.Random) -> dict[str, int]:
    """Each a little more or less; `left` is the part of the budget that is."""
    spread = NARROWEST + (WIDEST - NARROWEST) * left
    changed = {name: round(amount * math.exp(numbers.gauss(0, spread))) for name, amount in weights.items()}
    return {name: min(max(amount, LEAST_SHARES), MOST_SHARES) for name, amount in changed.items()}
