"""A scenario file as values. Times in the file count from the begin of their phase; here, from the timeline's."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from contextpolicy.errors import Fault, Finding, FindingsError, unreadable
from contextpolicy.policy.fields import Fields
from contextpolicy.policy.validation.documents import DocumentError, read
from modules.speech.synthesis import VOICES
from timelines.datasets.motion import Motion
from timelines.datasets.side_view import PLATE_TEXT, Plate, SideView
from timelines.datasets.side_view import RATE as SIDE_RATE
from timelines.datasets.speech import COMMANDS, Script, Utterance
from timelines.scenarios import mission

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    Event = TypeVar("Event")

FOLDER = Path(__file__).parent
NAME = r"[a-z][a-z0-9-]{0,62}"
MOST = 1000
"""Phases of a scenario, and events of a phase."""
CAMERA_RATE, SPEED = 10.0, 0.3
"""Hz of the stereo camera and m/s of the wheels, unless the scenario says otherwise."""


class ScenarioError(FindingsError):
    """A scenario that can't become a timeline; the message lists everything that is wrong."""


@dataclass(frozen=True, slots=True)
class Order:
    """An order to the arm at a moment, as the module understands it."""

    at: float
    order: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Phase:
    """A stretch in which the robot moves all the time, or never.

    `does` is what its mission says it does; `follows` how many orders a second the arm gets to follow something.
    """

    name: str
    start: float
    end: float
    moves: bool
    does: str = ""
    follows: float = 0.0
    says: tuple[Utterance, ...] = ()
    sees: tuple[Plate, ...] = ()
    arm: tuple[Order, ...] = ()


@dataclass(frozen=True, slots=True)
class Scenario:
    """One story. `camera_rate` is the stereo camera's in Hz, `side_rate` the other's, `speed` the robot's in m/s."""

    name: str
    description: str
    phases: tuple[Phase, ...]
    speed: float = SPEED
    camera_rate: float = CAMERA_RATE
    side_rate: float = SIDE_RATE

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.phases[-1].end

    @property
    def motion(self) -> Motion:
        """How the robot moves; phases that follow each other moving are one journey."""
        journeys: list[tuple[float, float]] = []
        for phase in self.phases:
            if phase.moves:
                joined = bool(journeys) and journeys[-1][1] == phase.start
                start = journeys.pop()[0] if joined else phase.start
                journeys.append((start, phase.end))
        return Motion(self.duration, tuple(journeys), self.speed)

    @property
    def script(self) -> Script:
        """What is said."""
        return Script(self.duration, tuple(said for phase in self.phases for said in phase.says))

    @property
    def side_view(self) -> SideView:
        """What the side camera sees."""
        plates = tuple(plate for phase in self.phases for plate in phase.sees)
        return SideView(self.duration, plates, rate=self.side_rate)

    @property
    def has_mission(self) -> bool:
        """Whether a mission drives the robot, by what its modules find out, instead of a person with orders."""
        return any(phase.does for phase in self.phases)


def shipped() -> dict[str, Scenario]:
    """The scenarios of this folder, by name."""
    scenarios = [load(path) for path in sorted(FOLDER.glob("*.yaml"))]
    return {scenario.name: scenario for scenario in scenarios}


def load(path: Path) -> Scenario:
    """Read a file; ScenarioError carries everything that is wrong with it."""
    try:
        documents = list(read(path.read_text(encoding="utf-8")))
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(str(path), (Finding("", None, unreadable(error), Fault.FILE),)) from error
    except DocumentError as error:
        raise ScenarioError(f"{path}:{error.position.line}", (Finding("", None, str(error), Fault.FILE),)) from error
    if len(documents) != 1:
        raise ScenarioError(str(path), (Finding("file", f"{len(documents)} documents", "one YAML document"),))
    repeated = tuple(Finding(name, "given twice", "each key once") for name in documents[0].duplicates)
    return parse(documents[0].body, subject=str(path), findings=list(repeated))


def parse(body: object, *, subject: str = "scenario", findings: list[Finding] | None = None) -> Scenario:
    """Turn a decoded document into a scenario; ScenarioError carries all findings."""
    found = findings if findings is not None else []
    fields = Fields(body, "scenario", found)
    scenario = Scenario(
        name=fields.text("name", pattern=NAME, allowed="lower-case letters, digits and '-', a letter first"),
        description=fields.text("description", allowed="what the story is about"),
        phases=tuple(_phases(fields.nested_list("phases", limit=MOST))),
        speed=_above_zero(fields, "speed", SPEED, most=0.5, unit="m/s"),
        camera_rate=_above_zero(fields, "camera", CAMERA_RATE, most=60.0, unit="Hz"),
        side_rate=_above_zero(fields, "side_camera", SIDE_RATE, most=30.0, unit="Hz"),
    )
    fields.close()
    if not scenario.phases and not found:
        fields.refuse("phases", fields.raw("phases"), "a list of at least one phase")
    if found:
        raise ScenarioError(subject, tuple(found))
    return scenario


def _phases(listed: list[Fields]) -> Iterator[Phase]:
    start = 0.0
    for fields in listed:
        length = _above_zero(fields, "for", None, most=3600.0, unit="seconds")
        phase = _Phase(fields, start, length)
        yield Phase(
            name=fields.text("name", pattern=r"[^\x00-\x1f]{1,80}", allowed="one line of at most 80 characters"),
            start=start,
            end=start + length,
            moves=fields.flag("moves"),
            does=_one_of(fields, "does", mission.KINDS, "") if "does" in fields else "",
            follows=_above_zero(fields, "follows", None, most=20.0, unit="Hz") if "follows" in fields else 0.0,
            says=tuple(phase.events("says", phase.said)),
            sees=tuple(phase.events("sees", phase.seen)),
            arm=tuple(phase.events("arm", phase.order)),
        )
        fields.close()
        start = round(start + length, 6)


class _Phase:
    """The events of one phase."""

    def __init__(self, fields: Fields, start: float, length: float) -> None:
        self._fields, self._start, self._length = fields, start, length

    def events(self, name: str, read: Callable[[Fields, float], Event]) -> list[Event]:
        events = []
        for fields in self._fields.nested_list(name, limit=MOST):
            events.append(read(fields, self._moment(fields, "at")))
            fields.close()
        return events

    def said(self, fields: Fields, at: float) -> Utterance:
        return Utterance(at, _one_of(fields, "command", COMMANDS), _one_of(fields, "voice", VOICES, "slt"))

    def seen(self, fields: Fields, at: float) -> Plate:
        length = _above_zero(fields, "for", None, most=3600.0, unit="seconds")
        end = round(at + length, 6)
        if end > self._start + self._length:
            fields.refuse("for", length, f"at most until the phase ends, {self._start + self._length - at:g} s")
        return Plate(at, end, fields.text("sign", pattern=PLATE_TEXT, allowed="1 to 6 digits and capital letters"))

    def order(self, fields: Fields, at: float) -> Order:
        order = {name: fields.raw(name) for name in ("move", "home", "grip", "stop", "relax") if name in fields}
        if not order:
            fields.refuse("", None, "an order of the arm: move, home, grip, stop or relax")
        return Order(at, order)

    def _moment(self, fields: Fields, name: str) -> float:
        at = fields.number(name)
        if at is None or at >= self._length:
            fields.refuse(name, at, f"seconds from the phase's begin, below its {self._length:g} s")
            return self._start
        return round(self._start + at, 6)


def _above_zero(fields: Fields, name: str, default: float | None, *, most: float, unit: str) -> float:
    given = name in fields
    value = fields.number(name) if given else default
    fields.raw(name)
    if value is None and given:
        return most  # refused already
    if value is None or not 0 < value <= most:
        fields.refuse(name, value, f"{unit}, above 0 and at most {most:g}")
        return most
    return value


def _one_of(fields: Fields, name: str, known: Any, default: str | None = None) -> str:
    value = fields.text(name, default, allowed="one of " + ", ".join(known))
    if value and value not in known:
        fields.refuse(name, value, "one of " + ", ".join(known))
    return value
