"""A planner that keeps what a robot's forgets: each sample and expression that failed, and on which values."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from contextpolicy.planning.planner import Planner
from contextpolicy.policy.cel import Expression
from contextpolicy.policy.validation.shapes import of_example

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.policy.spec import Policy

LONGEST_VALUE = 60


@dataclass(slots=True)
class Failure:
    """An expression that failed: the first reason, the values that it read then, and how often it failed."""

    reason: str
    values: str
    count: int = 0


class NotingPlanner(Planner):
    """A planner that remembers each failure and its values; on a robot an expression that recovers is forgotten."""

    def __init__(self, policy: Policy) -> None:
        self.failures: dict[str, Failure] = {}
        super().__init__(policy, self, {})

    def on_health(self) -> None:
        """Nothing: a simulation is read when it has ended."""

    def on_expression_error(self, source: str, reason: str) -> None:
        """Note the first failure with the values that the expression reads, and count them all."""
        super().on_expression_error(source, reason)
        if source not in self.failures:
            self.failures[source] = Failure(_first_sentence(reason), "; ".join(self._values(source)))
        self.failures[source].count += 1

    def on_drop(self, stream: str, reason: str, detail: str = "") -> None:
        """Note the first sample that the stream's own expressions fail on, and count them all."""
        super().on_drop(stream, reason, detail)
        if detail:
            own = f"stream {stream}, samples not used"
            self.failures.setdefault(own, Failure(_first_sentence(detail), "")).count += 1

    def _values(self, source: str) -> Iterator[str]:
        for path in sorted(Expression(source).reads):
            value: Any = self.streams[path[0]].value
            for name in path[1:]:
                value = value.get(name) if isinstance(value, dict) else None
            if value is not None:
                yield f"{'.'.join(path)} is {_shown(value)}, {of_example(value, '').kind}"


def _first_sentence(text: str) -> str:
    """The rest of the CEL library's messages is general advice."""
    return text.partition("\n")[0].partition(". ")[0]


def _shown(value: object) -> str:
    text = json.dumps(value, default=str)
    return text if len(text) <= LONGEST_VALUE else text[: LONGEST_VALUE - 3] + "..."
