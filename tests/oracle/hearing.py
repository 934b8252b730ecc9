"""What a stream says at a moment, computed from all that was ever said on it."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple

from tests.oracle.language import Value, evaluate
from tests.oracle.units import SECOND, duration

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from tests.oracle.story import Happening, Moment


class Heard(NamedTuple):
    """`value` is the newest sample that counts, with features; `samples` how many do, `since` when the last came."""

    value: Mapping[str, Value] | None
    since: int | None
    silent: bool
    samples: int


def hear(stream: Mapping[str, Any], log: Sequence[tuple[Happening, bool]], since: int, moment: Moment) -> Heard:
    """`log` has the stream's happenings from `since` on, each with whether it was the first of its instant."""
    ear = _Ear(stream, since)
    for happening, first in log:
        ear.wait(happening.at, timed=not first)
        ear.take(happening)
    ear.wait(moment.at, timed=moment.timed)
    value = None if ear.value is None else {**ear.value, **dict(_features(stream, ear.counted, moment))}
    return Heard(value, ear.counted[-1][0] if ear.counted else None, ear.silent, len(ear.counted))


@dataclass
class _Ear:
    """Goes through the log: which samples pass the gate, and when nothing came for too long."""

    stream: Mapping[str, Any]
    last: int
    silent: bool = False
    value: Mapping[str, Value] | None = None
    counted: list[tuple[int, Mapping[str, Value]]] = field(default_factory=list)
    held: Mapping[str, Value] | None = None
    held_until: int = 0
    open_at: int = 0

    def take(self, happening: Happening) -> None:
        if happening.fields is None:
            self._fall_silent()
            return
        at, fields = happening.at, happening.fields
        self.last, self.silent = at, False
        if "debounce" in self.stream:
            self.held, self.held_until = fields, at + duration(self.stream["debounce"])
        elif at < self.open_at:
            self.held, self.held_until = fields, self.open_at
        else:
            self._pass(fields, at)

    def wait(self, until: int, *, timed: bool) -> None:
        """Let pass what is due before `until`, or at it too; of one instant silence comes first."""
        last = until if timed else until - 1
        stale_at = self.last + duration(self.stream["staleAfter"]) if "staleAfter" in self.stream else last + 1
        if self.held is not None and self.held_until <= last and self.held_until < stale_at:
            self._pass(self.held, self.held_until)
        if stale_at <= last:
            self._fall_silent()

    def _pass(self, fields: Mapping[str, Value], at: int) -> None:
        self.held = None
        self.open_at = at + duration(self.stream.get("sampleEvery", "0s"))
        if "filter" not in self.stream or evaluate(self.stream["filter"], _Alone(fields)):
            self.value = fields
            self.counted.append((at, fields))

    def _fall_silent(self) -> None:
        self.silent, self.value, self.held = True, None, None


class _Alone(NamedTuple):
    """A sample by itself, as filters see it."""

    sample: Mapping[str, Value]

    def fields(self, stream: str) -> Mapping[str, Value]:
        assert stream
        return self.sample

    def is_older(self, stream: str, age: int, *, strictly: bool) -> bool:
        raise NotImplementedError

    def is_active(self, context: str) -> bool:
        raise NotImplementedError


def _features(
    stream: Mapping[str, Any], counted: Sequence[tuple[int, Mapping[str, Value]]], moment: Moment
) -> Iterator[tuple[str, Value]]:
    for feature in stream.get("features", ()):
        over = duration(feature["over"])
        # A sample leaves when it is exactly that old: the next sample of its stream already finds it gone.
        inside = [fields for at, fields in counted if not moment.is_due(at + over) and at + over > counted[-1][0]]
        value = _over(feature, inside, over)
        if value is not None:
            yield feature["name"], value


def _over(feature: Mapping[str, Any], samples: Sequence[Mapping[str, Value]], over: int) -> Fraction | None:
    if feature["op"] in {"count", "rate"}:
        return Fraction(len(samples) * SECOND, over if feature["op"] == "rate" else SECOND)
    numbers = [Fraction(evaluate(feature["of"], _Alone(sample)) or 0) for sample in samples]
    if not numbers:
        return None
    match feature["op"]:
        case "mean":
            return sum(numbers, Fraction(0)) / len(numbers)
        case "min":
            return min(numbers)
        case _:
            return max(numbers)
