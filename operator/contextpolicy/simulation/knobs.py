"""What can be tuned in a policy without changing what it means: weights, bounds and delays, as written in its spec.

Conditions, suspensions, selectors and order are the author's, and stay.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from contextpolicy.policy.quantities import parse_cpu, parse_duration

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

Path: TypeAlias = tuple[str | int, ...]
Values: TypeAlias = dict[Path, Any]
"""New values by their place in the resource."""

FACTORS = (0.5, 2.0, 0.2, 5.0)
DELAYS = (0.0, 0.1, 0.5, 1.0, 2.0)
"""Seconds."""
FLOORS = (1.1, 1.5, 2.0)
"""A task's demand in cores, times these, is worth trying as its `min` and `max`."""
QUANTUM = 10
"""Thousandths of a core: the step of bounds."""


@dataclass(frozen=True, slots=True)
class Knob:
    """One place, and the values that are worth trying there, nearest first."""

    path: Path
    values: tuple[Any, ...]
    is_floor: bool = False
    """Whether it is a `min`, where the least that suffices is best: what it reserves, the others lack."""

    def __str__(self) -> str:
        return "/" + "/".join(map(str, self.path))


def knobs(resource: Mapping[str, Any], demand: Mapping[str, float], *, delays: bool = False) -> list[Knob]:
    """Every knob of a resource; `demand` is the mean need of each task in cores, as far as it is known.

    Bounds come first, since they follow from what a task needs; then weights, then `delays` and holds where asked for:
    they are there against flicker that a timeline may not show.
    """
    spec = resource["spec"]
    tasks = [(("spec", "tasks", index), task) for index, task in enumerate(spec["tasks"]) if not task.get("subtasks")]
    contexts = [(("spec", "contexts", index), context) for index, context in enumerate(spec.get("contexts", ()))]
    return [
        *(knob for path, task in tasks for knob in _bounds(path, task, demand)),
        *(knob for path, context in contexts for knob in _changes(path, context)),
        *(knob for path, task in tasks for knob in _scaled(path, {"priority": 1, **task}, ("priority", "idle"))),
        *(knob for path, context in contexts if delays for knob in _delays(path, context)),
        *(knob for path, task in tasks if delays for knob in _holds(path, task)),
    ]


def _bounds(path: Path, task: Mapping[str, Any], demand: Mapping[str, float]) -> Iterator[Knob]:
    if task["name"] in demand:
        yield from (_bound((*path, name), task.get(name), demand[task["name"]]) for name in ("min", "max"))


def _changes(path: Path, context: Mapping[str, Any]) -> Iterator[Knob]:
    for task, change in context.get("tasks", {}).items():
        yield from _scaled((*path, "tasks", task), change, ("weight", "scale"))


def _delays(path: Path, context: Mapping[str, Any]) -> Iterator[Knob]:
    if context.get("when") is not None:
        yield from (_delay((*path, name), context.get(name)) for name in ("enterAfter", "exitAfter"))


def _holds(path: Path, task: Mapping[str, Any]) -> Iterator[Knob]:
    for index, activity in enumerate(task.get("activity", ())):
        if activity.get("hold") is not None:
            yield _delay((*path, "activity", index, "hold"), activity["hold"])


def turned(resource: Mapping[str, Any], values: Values) -> dict[str, Any]:
    """The resource with new values."""
    changed: dict[str, Any] = copy.deepcopy(dict(resource))
    for path, value in values.items():
        inner: Any = changed
        for step in path[:-1]:
            inner = inner[step]
        inner[path[-1]] = value
    return changed


def patch(resource: Mapping[str, Any], values: Values) -> list[dict[str, Any]]:
    """A JSON patch (RFC 6902), for `kubectl patch --type json`."""
    return [
        {"op": "add" if _at(resource, path) is None else "replace", "path": _pointer(path), "value": value}
        for path, value in sorted(values.items(), key=lambda item: list(map(str, item[0])))
    ]


def _pointer(path: Path) -> str:
    return "/" + "/".join(str(step).replace("~", "~0").replace("/", "~1") for step in path)


def _at(resource: Mapping[str, Any], path: Path) -> Any:
    inner: Any = resource
    for step in path[:-1]:
        inner = inner[step]
    return inner.get(path[-1])


def _scaled(path: Path, fields: Mapping[str, Any], names: Sequence[str]) -> Iterator[Knob]:
    for name in names:
        value = fields.get(name)
        if isinstance(value, int | float) and value > 0:
            yield Knob((*path, name), tuple(_short(value * factor) for factor in FACTORS))


def _short(value: float) -> float:
    rounded = float(f"{value:.3g}")
    return int(rounded) if rounded == int(rounded) else rounded


def _delay(path: Path, value: object) -> Knob:
    now = 0.0 if value is None else _read(parse_duration, value, 0.0)
    return Knob(path, tuple(f"{delay * 1000:g}ms" for delay in DELAYS if delay != now))


def _bound(path: Path, value: object, demand: float) -> Knob:
    own = None if value is None else _read(parse_cpu, value, None)
    wanted = [max(QUANTUM, -(-round(demand * factor * 1000) // QUANTUM) * QUANTUM) for factor in FLOORS]
    around = [] if own is None else [max(QUANTUM, own // 2 // QUANTUM * QUANTUM), own * 2]
    values = tuple(f"{cores}m" for cores in dict.fromkeys([*wanted, *around]) if cores != own)
    return Knob(path, values, is_floor=path[-1] == "min")


def _read(parse: Callable[[object], Any], value: object, otherwise: Any) -> Any:
    try:
        return parse(value)
    except ValueError:
        return otherwise
