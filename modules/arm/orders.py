"""Orders as they come over the bus: `stop`, `relax`, `home`, or a place and an opening of the grip."""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, Any, TypeGuard

from modules.arm.kinematics import Unreachable
from robotkit import MessageError, json_text

if TYPE_CHECKING:
    from modules.arm.joints import Arm, Posture

GRIPS = {"open": 1, "closed": 0}
"""Which end of the grip's range they mean."""


class Order(Enum):
    """Orders without a goal."""

    STOP = "stop"
    RELAX = "relax"


def parse_order(payload: bytes, arm: Arm, current: Posture) -> Order | Posture:
    """Read an order; a goal is the posture that it leads to. MessageError names the field and what was expected."""
    try:
        document = json_text.loads(payload)
    except ValueError as error:
        raise MessageError(f"not JSON: {error}") from error
    match document:
        case {"stop": True}:
            return Order.STOP
        case {"relax": True}:
            return Order.RELAX
    try:
        return _goal(document, arm, current)
    except Unreachable as error:
        raise MessageError(str(error)) from error


def _goal(document: Any, arm: Arm, current: Posture) -> Posture:
    fields = {name: value for name, value in document.items() if name != "stamp"} if isinstance(document, dict) else {}
    if not fields or fields.keys() - {"move", "home", "grip"} or ("move" in fields and "home" in fields):
        allowed = '{"stop": true}, {"relax": true}, {"home": true}, {"move": [x, y, z]} in mm, or {"grip": degrees}'
        more = "a grip may accompany a move or home"
        raise MessageError(f"order: invalid value {document!r}: expected {allowed}; {more}")
    grip = _grip(fields["grip"], arm) if "grip" in fields else current["grip"]
    if "move" in fields:
        return arm.posture_at(_point(fields["move"]), grip=grip)
    if "home" in fields:
        return arm.posture_at(arm.home, grip=grip)
    return arm.checked({**current, "grip": grip})


def _point(value: object) -> tuple[float, float, float]:
    match value:
        case [x, y, z] if _is_number(x) and _is_number(y) and _is_number(z):
            return float(x), float(y), float(z)
    raise MessageError(f"move: invalid value {value!r}: expected [x, y, z] in mm")


def _grip(value: object, arm: Arm) -> float:
    ends = arm.joints["grip"].angle
    if isinstance(value, str) and value in GRIPS:
        return ends[GRIPS[value]]
    if _is_number(value):
        return float(value)
    raise MessageError(f"grip: invalid value {value!r}: expected {ends[0]:g} to {ends[1]:g} degrees, open or closed")


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e6
