"""A run in so few numbers that it can be committed, and from which every published figure is computed again. Pure.

Whole numbers throughout: responses and lateness in tenths of a millisecond, CPU in hundredths. A block is JSON in
columns, compressed by xz: `xz --decompress --stdout BLOCK | jq` reads it.
"""

from __future__ import annotations

import json
import lzma
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from timelines.experiments.accounting import Ended, Ending
from timelines.experiments.due import TENTHS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from timelines.experiments.due import Schedule

HUNDREDTHS = 100_000
"""Of a millisecond, in a second."""
FORMAT = 2
DONE = "d"
_LETTERS = {Ending.DROPPED: "x", Ending.SUSPENDED: "s", Ending.LOST: "l"}
_ENDINGS = {letter: ending for ending, letter in _LETTERS.items()}


class RecordError(Exception):
    """A block that can't be read."""


@dataclass(frozen=True, slots=True)
class Column:
    """One input of one task: a letter for each that was due (d: done, x: dropped, s: suspended, l: lost).

    `responses` and `cpu` are of those that were done, in order.
    """

    fates: str
    responses: Sequence[int]
    cpu: Sequence[int]

    @classmethod
    def of(cls, ended: Sequence[Ended]) -> Column:
        """Keep how inputs ended; whether one was late follows from the deadline."""
        fates = "".join(DONE if one.response is not None else _LETTERS[one.ending] for one in ended)
        responses = [round(one.response * TENTHS) for one in ended if one.response is not None]
        return cls(fates, responses, [round(one.cpu * HUNDREDTHS) for one in ended if one.cpu is not None])

    def ended(self, deadline: float) -> list[Ended]:
        """How the inputs ended, judged by a deadline in seconds."""
        timings = iter(zip(self.responses, self.cpu, strict=True))
        found = []
        for letter in self.fates:
            if letter == DONE:
                response, cpu = next(timings)
                ending = Ending.IN_TIME if response <= deadline * TENTHS else Ending.LATE
                found.append(Ended(ending, response / TENTHS, cpu / HUNDREDTHS))
            else:
                found.append(Ended(_ENDINGS[letter]))
        return found


@dataclass(frozen=True, slots=True)
class Record:
    """One run. `columns` are by task and input, `late` is the player's own lateness by key, `about` what it ran on.

    `plans` has [milliseconds, contexts, {task: [weight, thousandths of a core]}] for each change, `used` each
    container's CPU so far, in milliseconds, once a second. `commands` has [frame's number, latency] of the wheel
    commands that followed a pose, `stops` [number, latency] of those that followed a spoken "stop", from its end on.
    `accuracy` has [measure, value, unit, how many were judged, whether more is better] by task, and by `context: task`.
    `trusted` has a letter for each frame: 1 where SLAM trusted its pose, else 0.
    """

    load: str
    story: str
    configuration: str
    block: int
    columns: Mapping[str, Mapping[str, Column]]
    late: Mapping[str, Sequence[int]]
    about: Mapping[str, Any]
    plans: Sequence[Any] = ()
    used: Mapping[str, Sequence[int]] = field(default_factory=dict)
    commands: Sequence[Sequence[int]] = ()
    stops: Sequence[Sequence[int]] = ()
    accuracy: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    trusted: str = ""

    def ended(self, schedule: Schedule, task: str, deadline: float) -> list[Ended]:
        """How a task's inputs ended, in the order of `Schedule.of`."""
        return [end for name in schedule.inputs[task] for end in self.columns[task][name].ended(deadline)]

    def as_json(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)

    @classmethod
    def of_json(cls, value: Mapping[str, Any]) -> Record:
        """What `as_json` wrote."""
        columns = {
            task: {name: Column(**column) for name, column in own.items()} for task, own in value["columns"].items()
        }
        return cls(**{**value, "columns": columns})


def packed(value: object) -> bytes:
    """Compressed; the same value gives the same bytes."""
    text = json.dumps(value, separators=(",", ":"), sort_keys=True)
    return lzma.compress(text.encode(), preset=9 | lzma.PRESET_EXTREME)


def unpacked(data: bytes) -> Any:
    """What was packed; RecordError if it is something else."""
    try:
        return json.loads(lzma.decompress(data))
    except (lzma.LZMAError, ValueError) as error:
        raise RecordError(f"not valid packed JSON: {error}") from error


def write_whole(path: Path, data: bytes) -> None:
    """Write a file so that it has all of its content or is not there: what exists counts as finished."""
    draft = path.with_name(f"{path.name}.part")
    draft.write_bytes(data)
    draft.replace(path)


def block(records: Iterable[Record]) -> bytes:
    """A file with the records of a block."""
    return packed({"format": FORMAT, "records": [one.as_json() for one in records]})


def records(data: bytes) -> list[Record]:
    """The records of a block's file; RecordError if it is of another format."""
    found = unpacked(data)
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise RecordError(f"expected a block of format {FORMAT}")
    return [Record.of_json(one) for one in found["records"]]
