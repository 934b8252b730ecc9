"""Which evidence each command should need, so that little is invented and yet most is heard."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from modules.speech.listener import Teller
from modules.speech.spotter import KEYWORDS

if TYPE_CHECKING:
    from collections.abc import Iterable

    from modules.speech.listener import Heard

GOAL = 0.15
"""How many of each command may be invented in a minute: of all five together that is 0.75, and 1 is allowed."""
LOWEST, HIGHEST, STEP = -4.0, 8.0, 0.1


@dataclass
class Evidence:
    """The strongest evidence for each command in the clips of it, and all that there was for it in connected sound."""

    said: defaultdict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    invented: defaultdict[str, list[Heard]] = field(default_factory=lambda: defaultdict(list))
    seconds: float = 0

    def count(self, truth: str | None, candidates: Iterable[Heard], seconds: float) -> None:
        """Count what might be told of a clip of one word, or of connected sound that holds no command."""
        if truth in KEYWORDS:
            self.said[truth].append(max((one.evidence for one in candidates if one.keyword == truth), default=-np.inf))
        elif truth is None:
            self.seconds += seconds
            for one in candidates:
                self.invented[one.keyword].append(one)

    def threshold(self, keyword: str) -> float:
        """The lowest threshold that keeps to the goal."""
        steps = np.arange(LOWEST, HIGHEST + STEP / 2, STEP).round(1)
        return next((step for step in steps.tolist() if self.rate(keyword, step) <= GOAL), HIGHEST)

    def rate(self, keyword: str, threshold: float) -> float:
        """How many of a command are told in a minute without any."""
        return len(Teller({keyword: threshold}).tell(self.invented[keyword])) * 60 / max(self.seconds, 1)

    def report(self) -> str:
        """A line for each command: what is heard and invented with its threshold, and with half less or more."""
        lines = [f"{self.seconds / 60:.1f} minutes without commands"]
        for keyword in KEYWORDS:
            chosen = self.threshold(keyword)
            parts = (self._part(keyword, max(chosen + change, LOWEST)) for change in (0, -0.5, 0.5))
            lines.append(f"{keyword}: {'; '.join(parts)}")
        return "\n".join(lines)

    def _part(self, keyword: str, threshold: float) -> str:
        heard, said = sum(evidence >= threshold for evidence in self.said[keyword]), len(self.said[keyword])
        return f"at {threshold:.1f} {heard} of {said} heard, {self.rate(keyword, threshold):.2f} a minute invented"
