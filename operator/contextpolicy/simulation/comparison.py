"""Plans against expectations, in words."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from contextpolicy.simulation.forecast import stats

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.simulation.expectations import Expectation, Range
    from contextpolicy.simulation.forecast import Forecast


@dataclass(frozen=True, slots=True)
class Difference:
    """One thing that is not as expected; `plan` is the one whose shares are in force then, None before the first."""

    expectation: Expectation
    message: str
    plan: Plan | None

    def __str__(self) -> str:
        """Two lines: what differs, and the plan that it is about."""
        own = self.expectation
        when = (
            f"at {_exact(own.start)} s"
            if own.start == own.end
            else f"from {_exact(own.start)} s to {_exact(own.end)} s"
        )
        if self.plan is None:
            return f"line {own.line}, {when}: {self.message}"
        return (
            f"line {own.line}, {when}: {self.message}\n"
            f"    plan {self.plan.sequence} of {self.plan.time:.3f} s, caused by {self.plan.cause}"
        )


def differences(
    plans: Sequence[Plan], expectations: Sequence[Expectation], predicted: Forecast | None = None
) -> Iterator[Difference]:
    """Everything that is not as expected, in the order of the expectations; misses are those that are `predicted`."""
    # Plans of one number have the same shares; the first of them says when these were decided, and why.
    decided = {plan.sequence: plan for plan in reversed(plans)}
    for expectation in expectations:
        begun = [plan for plan in decided.values() if expectation.start <= plan.time <= expectation.end]
        if expectation.plans is not None and len(begun) not in expectation.plans:
            message = f"expected {_words(expectation.plans)} plans, but {len(begun)} began"
            yield Difference(expectation, message, begun[-1] if begun else None)
        if expectation.misses is not None and predicted is not None:
            yield from (Difference(expectation, message, None) for message in _missed(predicted, expectation))
        in_force = _in_force(plans, expectation)
        if not in_force:
            yield Difference(expectation, "there is no plan yet", None)
        for plan in in_force:
            yield from (
                Difference(expectation, message, decided[plan.sequence]) for message in _messages(plan, expectation)
            )


def _in_force(plans: Sequence[Plan], expectation: Expectation) -> list[Plan]:
    """The plan in force at the start and each later one until the end; of several at one instant the last counts."""
    before = [plan for plan in plans if plan.time <= expectation.start]
    later = [plan for plan in plans if expectation.start < plan.time <= expectation.end]
    settled = [plan for plan, following in pairwise(later) if plan.time != following.time] + later[-1:]
    return before[-1:] + settled


def _messages(plan: Plan, expected: Expectation) -> Iterator[str]:
    contexts, suspended = set(plan.contexts), {name for name, task in plan.tasks.items() if task.suspended}
    if expected.contexts is not None and contexts != expected.contexts:
        yield f"contexts: expected {_names(expected.contexts)}, but {_names(contexts)}"
    if expected.suspended is not None and suspended != expected.suspended:
        yield f"suspended: expected {_names(expected.suspended)}, but {_names(suspended)}"
    if expected.feasible is not None and expected.feasible is bool(plan.shortfalls):
        short = "; ".join(f"{s.task} {s.message}".strip() for s in plan.shortfalls) or "there are no shortfalls"
        yield f"feasible: expected {str(expected.feasible).lower()}, but {short}"
    shares = {name: float(task.share) for name, task in plan.tasks.items()}
    yield from _outside("share", shares, expected.shares or {}, lambda value: f"{_exact(value)}m")
    weights = {name: task.weight for name, task in plan.tasks.items()}
    yield from _outside("weight", weights, expected.weights or {}, _exact)


def _missed(predicted: Forecast, expected: Expectation) -> Iterator[str]:
    """Of the inputs that arrive in the interval."""
    for task, allowed in (expected.misses or {}).items():
        if task not in predicted.outcomes:
            yield f"misses of {task}: expected {_words(allowed)}, but it has no profile"
            continue
        own = [one for one in predicted.outcomes[task] if expected.start <= one.work.at <= expected.end]
        found = stats(own, predicted.deadlines[task])
        if found.misses not in allowed:
            times = "no input was completed" if found.p99 is None else f"p99 {found.p99:.3g} s"
            yield (
                f"misses of {task}: expected {_words(allowed)}, but {found.misses:.4g} "
                f"({found.missed} late and {found.dropped} dropped of {found.inputs} inputs; {times})"
            )


def _outside(
    what: str, actual: Mapping[str, float], expected: Mapping[str, Range], show: Callable[[float], str]
) -> Iterator[str]:
    for task, allowed in expected.items():
        if actual[task] not in allowed:
            yield f"{what} of {task}: expected {_words(allowed, show)}, but {show(actual[task])}"


def _exact(value: float) -> str:
    """The shortest text that reads back as this number: two that differ never look the same."""
    short = f"{value:g}"
    return short if float(short) == value else repr(value)


def _words(allowed: Range, show: Callable[[float], str] = _exact) -> str:
    if allowed.low == allowed.high:
        return show(allowed.low)
    if allowed.high == float("inf"):
        return f"at least {show(allowed.low)}"
    return f"at most {show(allowed.high)}" if not allowed.low else f"{show(allowed.low)} to {show(allowed.high)}"


def _names(names: set[str] | frozenset[str]) -> str:
    return ", ".join(sorted(names)) or "none"
