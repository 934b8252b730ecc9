"""The robot's state for answers: its pose, its tasks' health, and the policy's decisions. All times in s."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    Message = Mapping[str, Any]


class UnusableError(Exception):
    """A message that lacks what its key promises."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where the robot was at a time, in m from where it started; not `known` when it has lost its way."""

    at: float
    position: tuple[float, float, float]
    known: bool


@dataclass(frozen=True, slots=True)
class Pause:
    """A task was suspended: since when, until when if that is over, and why."""

    start: float
    because: str
    cause: str
    end: float | None = None


@dataclass
class TaskRecord:
    """A task as the newest plan has it, and its last pause."""

    share: float
    weight: float
    suspended: bool
    because: str
    pause: Pause | None = None


@dataclass
class Memory:
    """Grows with messages; answers are read from it."""

    place: Place | None = None
    contexts: list[str] = field(default_factory=list)
    tasks: dict[str, TaskRecord] = field(default_factory=dict)
    misses: dict[str, tuple[float, float]] = field(default_factory=dict)
    """By task: when it was reported, and the fraction of its inputs that was late."""
    _orders: dict[str, tuple[int, int]] = field(default_factory=dict)

    def see_pose(self, message: Message, at: float) -> None:
        """Remember where the robot is."""
        try:
            x, y, z = map(float, message["position"])
            known = bool(message.get("inliers", 1))
        except (KeyError, TypeError, ValueError) as error:
            raise UnusableError(f"a pose without a position of three numbers: {error!r}") from error
        self.place = Place(at, (x, y, z), known)

    def see_health(self, task: str, message: Message, at: float) -> None:
        """Remember how a task fares."""
        try:
            self.misses[task] = at, float(message["misses"])
        except (KeyError, TypeError, ValueError) as error:
            raise UnusableError(f"a health message without misses: {error!r}") from error

    def see_plan(self, message: Message, at: float) -> None:
        """Remember a plan in force; one that is older than the last of its policy, or a dry run, is ignored."""
        try:
            order = int(message["run"]), int(message["sequence"])
            policy, enforced = str(message.get("policy", "")), message["mode"] == "Enforce"
            tasks = {
                str(name): TaskRecord(
                    float(task["share"]), float(task["weight"]), bool(task["suspended"]), str(task.get("because", ""))
                )
                for name, task in message["tasks"].items()
            }
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise UnusableError(f"a plan that lacks what plans have: {error!r}") from error
        if not enforced or order <= self._orders.get(policy, (-1, -1)):
            return
        self._orders[policy] = order
        self.contexts = [str(context) for context in message.get("contexts", ())]
        for name, task in tasks.items():
            task.pause = _pause(self.tasks.get(name), task, str(message.get("cause", "")), at)
            self.tasks[name] = task


def _pause(before: TaskRecord | None, now: TaskRecord, cause: str, at: float) -> Pause | None:
    last = before.pause if before else None
    running = last is not None and last.end is None
    if now.suspended and not running:
        return Pause(at, now.because, cause)
    if last is not None and running and not now.suspended:
        return Pause(last.start, last.because, last.cause, at)
    return last
