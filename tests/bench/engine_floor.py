"""What a sample costs at the least, in Python with this CEL library.

Read the JSON, show CEL what the policy's expressions read of it, evaluate those that read its stream: no order, no age,
no memory, no plan.
"""

from __future__ import annotations

import json
from collections import defaultdict
from typing import TYPE_CHECKING, Any

import cel

from contextpolicy.policy.cel import Expression
from contextpolicy.policy.cel_functions import RUN

if TYPE_CHECKING:
    from contextpolicy.policy.spec import Policy


class Floor:
    """The same samples as the engine's, and nothing decided about them."""

    def __init__(self, policy: Policy) -> None:
        self._context = cel.Context({}, dict(RUN))
        self._programs: dict[str, list[cel.Program]] = defaultdict(list)
        self._fields: dict[str, set[str]] = defaultdict(set)
        for source in _sources(policy):
            program, expression = cel.compile(source), Expression(source)
            for stream in expression.variables:
                self._programs[stream].append(program)
            for stream, field, *_ in expression.reads:
                self._fields[stream].add(field)

    def take(self, stream: str, payload: bytes) -> list[Any]:
        """The values of the expressions that read the stream."""
        value = json.loads(payload)
        self._context.add_variable(stream, {field: value[field] for field in self._fields[stream]})
        return [program.execute(self._context) for program in self._programs[stream]]


def _sources(policy: Policy) -> list[str]:
    """Every condition and score of the policy, as often as somebody evaluates it."""
    activities = [activity for task in policy.tasks for activity in task.activity]
    scores = [activity.score_from for activity in activities]
    conditions = [*(activity.when for activity in activities), *(context.when for context in policy.contexts)]
    return [source for source in (*conditions, *scores) if source]
