"""Results against ground truth: labels that hold over time, and events at one instant."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


@dataclass
class Confusion:
    """A confusion matrix: how often each true label was predicted as which."""

    counts: Counter[tuple[str, str]] = field(default_factory=Counter)

    def add(self, truth: str, predicted: str) -> None:
        """Count one answer."""
        self.counts[truth, predicted] += 1

    @property
    def labels(self) -> list[str]:
        """All labels that occur."""
        return sorted({label for pair in self.counts for label in pair})

    @property
    def accuracy(self) -> float:
        """Fraction of the answers that are right; 0 without answers."""
        return sum(self.counts[label, label] for label in self.labels) / max(self.counts.total(), 1)

    def recall(self, label: str) -> float:
        """Fraction of a label's occurrences that was predicted as such; 0 when it never occurs."""
        return self.counts[label, label] / max(sum(self.counts[label, predicted] for predicted in self.labels), 1)

    def table(self) -> str:
        """A Markdown table: a row for each true label, a column for each predicted one, and the recall."""
        labels = self.labels
        rows = [
            [f"**{truth}**", *(str(self.counts[truth, predicted]) for predicted in labels), f"{self.recall(truth):.1%}"]
            for truth in labels
        ]
        head = ["truth \\ predicted", *labels, "recall"]
        return "\n".join(f"| {' | '.join(row)} |" for row in [head, ["---"] * len(head), *rows])


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happens at a moment `at`, in seconds."""

    at: float
    label: str


@dataclass(frozen=True, slots=True)
class Matched:
    """How many events were found, how many were missed, and how many were invented."""

    found: int
    missed: int
    invented: int

    @property
    def recall(self) -> float:
        """Fraction of the true events that was found."""
        return self.found / max(self.found + self.missed, 1)


def match_events(truth: Iterable[Event], reported: Sequence[Event], *, early: float, late: float) -> Matched:
    """Pair each true event with the first unpaired report of its label from `early` s before to `late` s after it."""
    left = sorted(reported, key=lambda event: event.at)
    found = missed = 0
    for event in sorted(truth, key=lambda event: event.at):
        answer = next(
            (one for one in left if one.label == event.label and -early <= one.at - event.at <= late),
            None,
        )
        if answer is None:
            missed += 1
        else:
            left.remove(answer)
            found += 1
    return Matched(found, missed, len(left))
