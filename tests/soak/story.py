"""What happens in a soak, and when: drawn from a seed, so that a failed run can be repeated. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random

TASKS = ("slam", "speech", "arm")
NODE = ("apiserver", "kubelet", "containerd", "kine")
"""Parts of the node that are killed and started again."""
TROUBLES = (
    "slow API",
    "flood",
    "forged originals",
    "emptied originals",
    "foreign resize",
    "forged plan",
    "debugger",
    "crowd",
    "large policy",
)
"""What others do meanwhile, in good faith or not; each is over by itself."""
FILLING = ("flood", "crowd", "large policy")
"""Those that fill memory that is kept, such as the flight recorder's: in the first half only, as those of PODS."""
PODS = ("operator", "router")
"""Killed too, and started again by the kubelet; in the first half only, so that the second shows whether they grow."""

FLIP = 0.5
"""Seconds between two contexts."""
COMING, FAULT, TROUBLE = 7.0, 20.0, 12.0
"""Seconds between two pods that come or go, between two faults, and between two troubles, at the mean."""
AWAY = (1.0, 8.0)
"""For how long a part of the node is away, in seconds."""
CALM = 0.1
"""The part of the soak at its end in which nothing is killed."""


@dataclass(frozen=True)
class Flip:
    """The robot stands or moves, and it is loud or quiet."""

    at: float
    speed: float
    level: float


@dataclass(frozen=True)
class Coming:
    """A task's pod goes, and another one comes with this CPU limit in thousandths of a core."""

    at: float
    task: str
    limit: int


@dataclass(frozen=True)
class Killing:
    """SIGKILL; a part of the node is started again after some seconds."""

    at: float
    part: str
    away: float


@dataclass(frozen=True)
class Trouble:
    """Somebody does what does not concern the policy, or should not."""

    at: float
    kind: str
    task: str


Event = Flip | Coming | Killing | Trouble


def story(seed: int, duration: float) -> list[Event]:
    """All that happens, in order."""
    random = Random(seed)  # noqa: S311 - no secret, a story
    flips = [_flip(random, number * FLIP) for number in range(int(duration / FLIP))]
    comings = [_coming(random, at) for at in _moments(random, COMING, duration)]
    busy = duration * (1 - CALM)
    killings = [_killing(random, at, early=at < duration / 2) for at in _moments(random, FAULT, busy)]
    troubles = [_trouble(random, at, early=at < duration / 2) for at in _moments(random, TROUBLE, busy)]
    return sorted([*flips, *comings, *killings, *troubles], key=lambda event: event.at)


def _flip(random: Random, at: float) -> Flip:
    return Flip(at, random.choice((0.0, 0.3)), random.choice((0.0, 0.9)))


def _coming(random: Random, at: float) -> Coming:
    return Coming(at, random.choice(TASKS), random.randrange(100, 900, 50))


def _killing(random: Random, at: float, *, early: bool) -> Killing:
    part = random.choice((*NODE, *PODS) if early else NODE)
    return Killing(at, part, random.uniform(*AWAY))


def _trouble(random: Random, at: float, *, early: bool) -> Trouble:
    kinds = [kind for kind in TROUBLES if early or kind not in FILLING]
    return Trouble(at, random.choice(kinds), random.choice(TASKS))


def _moments(random: Random, mean: float, until: float) -> list[float]:
    """Moments without a rhythm, the first of them soon."""
    found, at = [], random.uniform(0, mean)
    while at < until:
        found.append(at)
        at += random.expovariate(1 / mean)
    return found
