"""Orders as they come over the bus: `{"stop": true}`, `{"waypoints": [[x, y], ...]}`, `{"drive": {...}}`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from modules.navigation.pilot import DRIVE_PATIENCE, Drive
from modules.navigation.waypoints import Motion, Route
from robotkit import MessageError, json_text

if TYPE_CHECKING:
    from collections.abc import Sequence

MOST_WAYPOINTS = 1000
FARTHEST = 1000.0
FASTEST, FASTEST_TURN = 0.5, 4.0
"""m/s and rad/s: both wheels of a Create 2 at 500 mm/s."""
STOP = "stop"
FARTHEST_RANGE = 100.0


def parse_order(payload: bytes, now: float) -> Drive | Route | str:
    """Read an order; STOP stands for itself. MessageError names the field and what was expected."""
    document = _json(payload)
    match document:
        case {"stop": True}:
            return STOP
        case {"waypoints": list(waypoints)}:
            return Route(_waypoints(waypoints))
        case {"drive": {"forward": forward, **rest}}:
            motion = Motion(_number("forward", forward, FASTEST), _number("turn", rest.get("turn", 0), FASTEST_TURN))
            return Drive(motion, now + DRIVE_PATIENCE)
    allowed = '{"stop": true}, {"waypoints": [[x, y], ...]} or {"drive": {"forward": m/s, "turn": rad/s}}'
    raise MessageError(f"order: invalid value {payload[:80]!r}: expected {allowed}")


def parse_ranges(payload: bytes) -> Sequence[float]:
    """Read the ranges of a scan."""
    match _json(payload):
        case {"ranges": list(ranges)} if ranges and all(_is_range(each) for each in ranges):
            return ranges
    raise MessageError(f"scan: invalid value {payload[:80]!r}: expected `ranges`, a list of metres from 0 to 100")


def _json(payload: bytes) -> Any:
    try:
        return json_text.loads(payload)
    except ValueError as error:  # also when it is no UTF-8
        raise MessageError(f"not JSON: {error}") from error


def _waypoints(waypoints: list[Any]) -> list[tuple[float, float]]:
    if len(waypoints) > MOST_WAYPOINTS:
        raise MessageError(f"waypoints: {len(waypoints)} of them: expected at most {MOST_WAYPOINTS}")
    points = []
    for index, waypoint in enumerate(waypoints):
        if not isinstance(waypoint, list) or len(waypoint) != 2:
            raise MessageError(f"waypoints[{index}]: invalid value {waypoint!r}: expected [x, y]")
        points.append((_number(f"waypoints[{index}][0]", waypoint[0]), _number(f"waypoints[{index}][1]", waypoint[1])))
    return points


def _number(field: str, value: object, most: float = FARTHEST) -> float:
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= most:
        return float(value)
    raise MessageError(f"{field}: invalid value {value!r}: expected a number from {-most:g} to {most:g}")


def _is_range(value: object) -> bool:
    return (type(value) is float or type(value) is int) and 0 <= value <= FARTHEST_RANGE
