"""The stories that are played: on which of them something is tuned, and which are held out. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

SCENARIOS = Path(__file__).with_name("stories")
POLICIES = Path(__file__).with_name("policies")


class Use(StrEnum):
    """What a story is for."""

    TUNING = "tuning"
    """Loads are calibrated and static weights are searched on these, and nothing is reported of them."""
    HELD_OUT = "held out"
    """Frozen before they are played, and nothing is tuned on them: the figures."""
    PAPER = "the paper's"
    """Its three experiments, under its terms."""


CRITICAL: Mapping[str, str] = {
    "drive": "slam",
    "talk": "speech",
    "read": "signs",
    "grip": "arm",
    "moving": "slam",
}
"""The task that each context is about: the one of the highest weight in the policies of these stories."""
PROTECTED = ("navigation", "imu")
"""The tasks that no context may stop."""


@dataclass(frozen=True, slots=True)
class Story:
    """A timeline with the policy that its contexts come from; `seconds` is its length.

    Where it is lossless, queues drop nothing and a run ends when they are empty, as in the paper (VI-B).
    """

    name: str
    use: Use
    seconds: float
    policy: str = "mission"
    lossless: bool = False

    @property
    def policy_file(self) -> Path:
        """The policy's file."""
        return POLICIES / f"{self.policy}.yaml"


TUNING = tuple(Story(name, Use.TUNING, 30) for name in ("errand", "tour", "workshop", "reception"))
HELD_OUT = tuple(Story(name, Use.HELD_OUT, 60) for name in ("library", "hotel"))
PAPER = tuple(
    Story(name, Use.PAPER, seconds, "paper", lossless=True)
    for name, seconds in (("exp1", 180), ("exp2", 60), ("exp3", 15))
)
STORIES: Mapping[str, Story] = {story.name: story for story in (*TUNING, *HELD_OUT, *PAPER)}
