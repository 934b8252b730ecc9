"""Better weights, bounds and delays for a policy, by trying them in the simulation. Pure: the judge is an argument.

One knob is turned at a time, and left where it helps; rounds go on until none helps any more. In the end each change is
undone if that costs nothing, so that the patch holds only what matters, and floors are lowered while they suffice.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from contextpolicy.policy.quantities import parse_cpu
from contextpolicy.simulation.forecast import ALL
from contextpolicy.simulation.knobs import QUANTUM

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from contextpolicy.simulation.forecast import Forecast
    from contextpolicy.simulation.knobs import Knob, Path, Values

CHURN = 0.01
"""What a plan a second costs: fewer are better where misses are the same, since each is a resize."""
WORTH = 1e-4
"""By how much a change must lower the cost to be kept."""


@dataclass(frozen=True, slots=True)
class Goal:
    """How much a task's misses matter, and how many are allowed."""

    priority: float
    misses: float


@dataclass(frozen=True, slots=True)
class SearchResult:
    """The best values, and what they cost; `tries` counts the policies that were simulated."""

    values: Values
    before: float
    after: float
    tries: int


def cost(forecasts: Sequence[Forecast], before: Sequence[Forecast], goals: Mapping[str, Goal]) -> float:
    """What a policy costs over all timelines: misses above the goal count a hundredfold.

    Inputs that are suspended, and were not `before`, count as missed: doing less must not count as an improvement.
    """
    total = sum(goal.priority for goal in goals.values()) or 1.0
    each = [
        CHURN * now.plans
        + sum(goal.priority / total * _task_cost(now, then, task, goal) for task, goal in goals.items())
        for now, then in zip(forecasts, before, strict=True)
    ]
    return sum(each) / max(len(each), 1)


def _task_cost(now: Forecast, then: Forecast, task: str, goal: Goal) -> float:
    own, old = (forecast.tasks.get(task, {}).get(ALL) for forecast in (now, then))
    if own is None or old is None:
        return 0.0
    misses = own.misses + max(own.suspended - old.suspended, 0) / max(own.inputs, 1)
    return misses + 100 * max(misses - goal.misses, 0.0)


def search(listed: Sequence[Knob], judge: Callable[[Values], float], tries: int) -> SearchResult:
    """Turn knobs as long as it helps; `judge` gives the cost of some values, infinite for a policy that is refused."""
    counting = _Counting(judge, tries)
    best: Values = {}
    before = after = counting.of(best)
    improved = True
    while improved and counting.left:
        improved = False
        for knob in listed:
            candidate, reached = _best_turn(knob, best, counting)
            if reached < after - WORTH:
                best, after, improved = candidate, reached, True
    for path in list(best):
        fewer = {place: value for place, value in best.items() if place != path}
        reached = counting.of(fewer, beyond=True)
        if reached <= after + WORTH:
            best, after = fewer, reached
    return SearchResult(best, before, after, counting.tries)


def lowest_floors(listed: Sequence[Knob], found: Values, suffices: Callable[[Values], bool]) -> Values:
    """The values with each floor among them as low as `suffices` allows, by halving."""
    best = dict(found)
    for knob in listed:
        if knob.is_floor and knob.path in best:
            low, high = 0, parse_cpu(best[knob.path]) // QUANTUM
            while high - low > 1:
                middle = (low + high) // 2
                enough = suffices({**best, knob.path: f"{middle * QUANTUM}m"})
                low, high = (low, middle) if enough else (middle, high)
            best[knob.path] = f"{high * QUANTUM}m"
    return best


def _best_turn(knob: Knob, values: Values, counting: _Counting) -> tuple[Values, float]:
    turns = [{**values, knob.path: value} for value in knob.values if values.get(knob.path) != value]
    judged = [(counting.of(turn), turn) for turn in turns if counting.left]
    reached, best = min(judged, key=lambda pair: pair[0], default=(float("inf"), values))
    return best, reached


class _Counting:
    """A judge that caches its answers, and stops after `tries` different policies."""

    def __init__(self, judge: Callable[[Values], float], tries: int) -> None:
        self._judge, self._most = judge, tries
        self._known: dict[frozenset[tuple[Path, str]], float] = {}

    @property
    def tries(self) -> int:
        return len(self._known)

    @property
    def left(self) -> bool:
        return self.tries < self._most

    def of(self, values: Values, *, beyond: bool = False) -> float:
        """The cost; infinite when no tries are left, unless it must be known."""
        key = frozenset((path, str(value)) for path, value in values.items())
        if key not in self._known:
            if not self.left and not beyond and self._known:
                return float("inf")
            self._known[key] = self._judge(values)
        return self._known[key]
