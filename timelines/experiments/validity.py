"""Whether a run counts: what its record says of the machine and of the recording, whatever the tasks did in it. Pure.

What the policy or the modules did wrong is no reason: their misses count.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from timelines.experiments.calm import DisturbedError
from timelines.experiments.configurations import CONFIGURATIONS
from timelines.experiments.due import TENTHS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from timelines.experiments.record import Record

ENOUGH = 0.97
"""Part of the pace that is left on average at least: the host may have been busy elsewhere for the rest."""
WORST = 0.7
"""The same in each second: a processor that stands still for longer makes its tasks late, however they are divided."""
MOST = 1.05
"""Part of it that is left on average at most: more would be another load."""
OFF = 0.2
"""How far a processor's speed may be from the one that limits counted on: they are CPU time, so at half the speed they
allow half the work. Of 92 runs under limits on one kind of machine the farthest was off by 19 %; on another the host
halved its speed between two runs."""
TOO_LATE, SELDOM = 0.2, 0.01
"""Seconds by which the player may be late itself, but for a part of all inputs: more is a machine that stood still."""


class RejectedError(DisturbedError):
    """A run that was played and recorded, and does not count."""

    def __init__(self, record: Record, reasons: Iterable[str]) -> None:
        super().__init__("; ".join(reasons))
        self.record = record


def reasons(record: Record) -> Iterator[str]:
    """Why a run does not count; nothing if it does."""
    yield from _pace(record.about["pace"])
    if CONFIGURATIONS[record.configuration].control == "Limit":
        yield from _speed(record.about)
    yield from _player(record.late)
    for name, missing in sorted(record.about.get("unheard", {}).items()):
        yield f"the recording lacks {missing} inputs that {name} has done"


def _pace(pace: Mapping[str, float]) -> Iterator[str]:
    """What thieves left, of what they were to leave."""
    if not ENOUGH <= pace["left"] <= MOST or pace["worst"] < WORST:
        said = f"{pace['left']:.0%} of their pace, and {pace['worst']:.0%} in their worst second"
        yield f"the processors had {said}: expected {ENOUGH:.0%} to {MOST:.0%}, and at least {WORST:.0%}"


def _speed(about: Mapping[str, Any]) -> Iterator[str]:
    """How fast the processors were, as a part of what limits counted on."""
    part = about["pace"]["speed"] / about["expected"]
    if abs(part - 1) > OFF:
        said = f"the processors were {part:.0%} as fast as the limits counted on"
        yield f"{said}: expected {1 - OFF:.0%} to {1 + OFF:.0%}"


def _player(late: Mapping[str, Sequence[int]]) -> Iterator[str]:
    """Whether the player was late so often that its inputs came in bursts."""
    every = [one > TOO_LATE * TENTHS for own in late.values() for one in own]
    part = sum(every) / max(len(every), 1)
    if part > SELDOM:
        said = f"{100 * part:.0f} % of the inputs were published more than {TOO_LATE} s late"
        yield f"{said}: expected at most {100 * SELDOM:.0f} %"
