"""All that was measured, as it is committed: what is due in each story, the runs of each block, what was frozen."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from timelines.experiments.configurations import ALONE
from timelines.experiments.due import Schedule
from timelines.experiments.metrics import Pair, Run
from timelines.experiments.record import Record, RecordError, packed, records, unpacked, write_whole
from timelines.experiments.stories import HELD_OUT

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from timelines.experiments.stories import Story

BLOCKS, SCHEDULES, FROZEN, ABSENT = "blocks", "schedules", "frozen.json", "not-run.json"
REJECTED = "rejected"
"""Folder of the attempts that were played and do not count, by block."""
PREPARED = "preparation"
"""Folder of the runs that findings follow from, beside the blocks, which have the figures."""
SEARCHES, SEARCH = ("ungated", "gated"), "tuning-"
"""The searches of static weights, and how their files' names begin."""
ENDING = ".json.xz"
FILM = "film"
"""Folder of strips of frames, for pictures."""


class Absent(NamedTuple):
    """A run that there should be, and why there is none."""

    load: str
    story: str
    configuration: str
    block: int
    reason: str


@dataclass(frozen=True, slots=True)
class Evidence:
    """`runs` are by load, story and configuration, then by block; `frozen` is what was calibrated before them.

    `absent` are runs that were wanted and could not be done; `searched` are those of all static weights that were
    tried, by the name of their search; `films` are the strips of frames that pictures show, by story; `rejected` are
    attempts that were played and do not count.
    """

    schedules: Mapping[str, Schedule]
    runs: Mapping[tuple[str, str, str], Mapping[int, Record]]
    frozen: Mapping[str, Any]
    absent: Sequence[Absent] = ()
    searched: Mapping[str, Sequence[Run]] = field(default_factory=dict)
    films: Mapping[str, Path] = field(default_factory=dict)
    rejected: Sequence[Record] = ()

    @classmethod
    def read(cls, folder: Path) -> Evidence:
        """All of a folder; nothing where there is none."""
        found: dict[tuple[str, str, str], dict[int, Record]] = {}
        for path in sorted((folder / BLOCKS).glob(f"*{ENDING}")):
            for one in records(path.read_bytes()):
                found.setdefault((one.load, one.story, one.configuration), {})[one.block] = one
        return cls(
            {path.name.removesuffix(ENDING): read_schedule(path) for path in _schedules(folder)},
            found,
            read_frozen(folder),
            [one for one in read_absent(folder) if one.block not in found.get(one[:3], {})],
            {name: read_search(folder, name) for name in SEARCHES},
            {path.stem: path for path in sorted((folder / FILM).glob("*.png"))},
            [one for path in sorted((folder / REJECTED).glob(f"*{ENDING}")) for one in records(path.read_bytes())],
        )

    def every(self) -> Iterator[Run]:
        """All runs that count."""
        return (Run(self.schedules[story], one) for (_, story, _), own in self.runs.items() for one in own.values())

    def of(self, load: str, story: str, configuration: str) -> list[Run]:
        """Its runs, by block."""
        own = self.runs.get((load, story, configuration), {})
        return [Run(self.schedules[story], own[block]) for block in sorted(own)]

    def pairs(
        self, load: str, configuration: str, against: str, stories: Sequence[Story] = HELD_OUT
    ) -> Iterator[tuple[int, Pair]]:
        """Each run beside the other configuration's in the same block; beside all of each task alone, which are few."""
        for story in (one.name for one in stories):
            bases = self.runs.get((load, story, against), {})
            for block, record in sorted(self.runs.get((load, story, configuration), {}).items()):
                for number in bases if against == ALONE.name else {block} & bases.keys():
                    yield block, Pair(self.schedules[story], record, bases[number])


def read_frozen(folder: Path) -> Mapping[str, Any]:
    """What was calibrated; empty before."""
    path = folder / FROZEN
    frozen: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    return frozen


def write_frozen(folder: Path, frozen: Mapping[str, Any]) -> None:
    """Keep it for people to read."""
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / FROZEN, f"{json.dumps(frozen, indent=1, sort_keys=True)}\n".encode())


def read_absent(folder: Path) -> list[Absent]:
    """Which runs there should be and could not be done; nothing where all were."""
    path = folder / ABSENT
    return [Absent(*one) for one in json.loads(path.read_text(encoding="utf-8"))] if path.exists() else []


def note_absent(folder: Path, cells: Iterable[tuple[str, str, str, int]], reason: str) -> None:
    """Keep for the report why runs could not be done; what was said of them before no longer holds."""
    folder.mkdir(parents=True, exist_ok=True)
    known = {one[:4]: one.reason for one in read_absent(folder)} | dict.fromkeys(cells, reason)
    lines = ",\n".join(f" {json.dumps([*cell, why])}" for cell, why in sorted(known.items()))
    write_whole(folder / ABSENT, f"[\n{lines}\n]\n".encode())


def read_search(folder: Path, name: str) -> list[Run]:
    """All runs of a search of static weights; none before."""
    prepared = folder / PREPARED
    path = prepared / f"{SEARCH}{name}{ENDING}"
    every = records(path.read_bytes()) if path.exists() else []
    due = {path.name.removesuffix(ENDING): read_schedule(path) for path in _schedules(prepared)}
    return [Run(due[one.story], one) for one in every]


def read_schedule(path: Path) -> Schedule:
    """What is due in a story."""
    return Schedule.of_json(unpacked(path.read_bytes()))


def film_file(folder: Path, story: str) -> Path:
    """Where a story's frames are kept."""
    return folder / FILM / f"{story}.png"


def write_schedule(folder: Path, story: str, schedule: Schedule) -> None:
    """Keep what is due; RecordError if it was something else, since runs of both can't be compared."""
    path = folder / SCHEDULES / f"{story}{ENDING}"
    if path.exists() and read_schedule(path).as_json() != schedule.as_json():
        raise RecordError(f"{path}: the story, its policy or a deadline has changed: begin again in an empty folder")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, packed(schedule.as_json()))


def _schedules(folder: Path) -> list[Path]:
    return sorted((folder / SCHEDULES).glob(f"*{ENDING}"))
