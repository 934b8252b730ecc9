"""Which evidence each command should need: as much as leaves most of its clips heard, and what is invented with it."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from modules.speech.keywords import KEYWORDS
from modules.speech.listener import Announcer

if TYPE_CHECKING:
    from collections.abc import Iterable

    from modules.speech.listener import Heard

GOAL = 0.9
"""The part of a command's clips that should be heard."""
LOWEST, HIGHEST, STEP = 0.0, 8.0, 0.5


@dataclass
class Evidence:
    """The strongest evidence for each command in the clips of it, and all that there was for it in connected sound."""

    said: defaultdict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    invented: defaultdict[str, list[Heard]] = field(default_factory=lambda: defaultdict(list))
    seconds: float = 0

    def count(self, truth: str | None, candidates: Iterable[Heard], seconds: float) -> None:
        """Count what might be announced for a clip of one word, or of connected sound that holds no command."""
        if truth in KEYWORDS:
            self.said[truth].append(max((one.evidence for one in candidates if one.keyword == truth), default=-np.inf))
        elif truth is None:
            self.seconds += seconds
            for one in candidates:
                self.invented[one.keyword].append(one)

    def threshold(self, keyword: str) -> float:
        """The highest with which enough is heard; if there is none, the lowest that is allowed."""
        steps = np.arange(HIGHEST, LOWEST - STEP, -STEP).tolist()
        enough = GOAL * len(self.said[keyword])
        return next((step for step in steps if self.heard(keyword, step) >= enough), LOWEST)

    def heard(self, keyword: str, threshold: float) -> int:
        """How many of a command's clips are heard."""
        return sum(evidence >= threshold for evidence in self.said[keyword])

    def rate(self, keyword: str, threshold: float) -> float:
        """How many of a command are announced per minute without any."""
        return len(Announcer({keyword: threshold}).announce(self.invented[keyword])) * 60 / max(self.seconds, 1)

    def report(self) -> str:
        """A line for each command: what is heard and invented with its threshold, and with half less or more."""
        lines = [f"{self.seconds / 60:.1f} minutes without commands"]
        for keyword in KEYWORDS:
            chosen = self.threshold(keyword)
            parts = (self._part(keyword, max(chosen + change, LOWEST)) for change in (0, -STEP, STEP))
            lines.append(f"{keyword}: {'; '.join(parts)}")
        return "\n".join(lines)

    def _part(self, keyword: str, threshold: float) -> str:
        heard, said = self.heard(keyword, threshold), len(self.said[keyword])
        return f"at {threshold:.1f} {heard} of {said} heard, {self.rate(keyword, threshold):.2f} a minute invented"
