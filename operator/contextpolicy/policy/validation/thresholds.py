"""Warnings about conditions that can't turn, and second thresholds that are none."""

from __future__ import annotations

from operator import le
from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.errors import Finding
from contextpolicy.policy.cel import Expression
from contextpolicy.policy.validation.cases import Cases, holds, implies, never_hold
from contextpolicy.policy.validation.silence import filters, lasting
from contextpolicy.policy.validation.unknowns import COMPARISONS, comparison_of
from contextpolicy.policy.written import expressions

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from collections.abc import Set as AbstractSet

    from contextpolicy.policy.cel_syntax import Node
    from contextpolicy.policy.spec import Policy
    from contextpolicy.policy.validation.cases import Case
    from contextpolicy.policy.validation.unknowns import Unknown


def thresholds(policy: Policy) -> Iterator[Finding]:
    """Each `until` that is no second threshold, and each condition that contradicts itself."""
    samples = _Samples(filters(policy), lasting(policy))
    for index, task in enumerate(policy.tasks):
        for number, activity in enumerate(task.activity):
            yield from _until(f"spec.tasks[{index}].activity[{number}].until", activity.when, activity.until, samples)
    for index, context in enumerate(policy.contexts):
        yield from _until(f"spec.contexts[{index}].until", context.when, context.until, samples)
    for written in expressions(policy):
        own = Expression(written.source)
        if written.is_number or not (own.variables or own.contexts):
            continue
        if never_hold(written.source):
            ends = ", so nothing ends it" if written.field.endswith(".until") else ""
            yield Finding(written.field, written.source, f"never holds: it contradicts itself{ends}")


def _until(field: str, when: str | None, until: str | None, samples: _Samples) -> Iterator[Finding]:
    if until is None:
        return
    own, begins = Expression(until), when or "true"
    if own.tree == Expression(begins).tree:
        yield Finding(field, until, "is the same as when: nothing begins while until holds, so this never does")
    elif not own.variables and not own.contexts:
        yield Finding(field, until, "reads nothing, so it never changes: true lets nothing begin, false ends nothing")
    elif not never_hold(begins, given=samples.given) and implies(begins, until, samples.given):
        yield Finding(field, until, "holds whenever when does: nothing begins while until holds, so this never does")
    elif _overlap(own.tree, Expression(begins).tree):
        message = "overlaps with when, and nothing begins while until holds: it begins and ends at this one threshold"
        yield Finding(field, until, message)
    elif samples.rule_out(begins, until):
        names = " and ".join(sorted(samples.lasting & own.variables))
        message = f"never holds once when did: without staleAfter and liveliness {names} stays heard for ever"
        yield Finding(field, until, message)


def _overlap(until: Node, when: Node) -> bool:
    """Whether they hold one operand against two constants, from both sides, with values between that meet both."""
    ends, begins = comparison_of(until), comparison_of(when)
    if ends is None or begins is None or ends[0] != begins[0] or {ends[1][0], begins[1][0]} != {"<", ">"}:
        return False
    own, other = ends[2], begins[2]
    return isinstance(own, str) is isinstance(other, str) and COMPARISONS[begins[1][0]](own, other)


class _Samples(NamedTuple):
    """What holds of those that count, and the streams that stay heard."""

    given: Sequence[str]
    lasting: AbstractSet[str]

    def rule_out(self, when: str, until: str) -> bool:
        """Whether what begins by `when` never ends by `until`: a stream that was heard does not cease to be."""
        cases = Cases(when, until, given=self.given)
        heard = [one for one in cases.values if one[0] == "heard" and one[1] in self.lasting]
        if not heard or not cases.known or never_hold(until, given=self.given):
            return False
        begun = {_states(heard, case) for case in cases if holds(when, case) and not holds(until, case)}
        ended = {_states(heard, case) for case in cases if holds(until, case)}
        return bool(begun) and not any(all(map(le, before, after)) for before in begun for after in ended)


def _states(heard: Sequence[Unknown], case: Case) -> tuple[bool, ...]:
    return tuple(bool(case[one]) for one in heard)
