"""A module's results as messages of ROS 2: what each kind of output can become.

A kind says what a result means, whatever its encoding:

    pose        {"position": [x, y, z], "orientation": [x, y, z, w]}, in metres; "covariance" if known, see below;
                "state": "lost" if it is only the last that was known, "adrift" if nobody knows how far it is off
    odometry    a pose, or {"position": [x, y], "heading": radians}, with the speeds "forward" (m/s) and "turn" (rad/s),
                and their "speed_covariance" if known
    scan        {"start_angle", "end_angle" (radians), "ranges" (m, 0: nothing seen), "range_min", "range_max" (m)}
    picture     bytes: a JPEG or PNG file

Covariances are those of ROS: 36 numbers, row by row, of x, y, z and the rotations about these axes (m2, rad2; of
speeds, per s2). Where a module does not know one, its variances are large: zero would say that the value is exact. A
lost pose becomes no message, and one that is adrift only a message that has a covariance.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from robotkit.module import Output

    Fields = Mapping[str, object]
    Make = Callable[[Any, Output], Fields | None]

LOST, ADRIFT = "lost", "adrift"
UNKNOWN = 1e6
"""A variance that says that nothing is known."""
_PNG = b"\x89PNG"


def allowed(kind: str) -> tuple[str, ...]:
    """The message types that outputs of a kind can be."""
    return tuple(_MAKERS[kind])


def fields_of(value: Mapping[str, object] | bytes, output: Output) -> Fields | None:
    """The message's fields for a result, None if there is nothing to publish; without a kind, the result as it is."""
    make = _MAKERS[output.kind].get(output.type) if output.kind else None
    if make is not None:
        return make(value, output)
    if isinstance(value, bytes):
        raise TypeError(f"invalid value of {len(value)} bytes: expected the fields of {output.type}")
    return value


def _pose(value: Mapping[str, Any], _: Output) -> Fields | None:
    return None if value.get("state") in (LOST, ADRIFT) else {"pose": _placed(value)}


def _pose_with_covariance(value: Mapping[str, Any], _: Output) -> Fields | None:
    return None if value.get("state") == LOST else {"pose": _estimate(value)}


def _odometry(value: Mapping[str, Any], output: Output) -> Fields | None:
    if value.get("state") == LOST:
        return None
    return {
        "child_frame_id": output.child_frame,
        "pose": _estimate(value),
        "twist": {"twist": _twist(value, output), "covariance": _covariance(value, "speed_covariance")},
    }


def _twist(value: Mapping[str, Any], _: Output) -> dict[str, object]:
    forward, turn = value.get("forward", 0.0), value.get("turn", 0.0)
    return {"linear": [forward, 0.0, 0.0], "angular": [0.0, 0.0, turn]}


def _twist_stamped(value: Mapping[str, Any], output: Output) -> dict[str, object]:
    return {"twist": _twist(value, output)}


def _scan(value: Mapping[str, Any], _: Output) -> dict[str, object]:
    ranges = [float(distance) or math.inf for distance in value["ranges"]]  # REP 117: nothing seen is infinitely far
    start, end = float(value["start_angle"]), float(value["end_angle"])
    return {
        "angle_min": start,
        "angle_max": end,
        "angle_increment": (end - start) / max(len(ranges) - 1, 1),
        "time_increment": value.get("time_increment", 0.0),
        "scan_time": value.get("scan_time", 0.0),
        "range_min": value.get("range_min", 0.0),
        "range_max": value.get("range_max", math.inf),
        "ranges": ranges,
    }


def _picture(value: bytes, _: Output) -> dict[str, object]:
    return {"format": "png" if value.startswith(_PNG) else "jpeg", "data": value}


def _estimate(value: Mapping[str, Any]) -> dict[str, object]:
    return {"pose": _placed(value), "covariance": _covariance(value, "covariance")}


def _placed(value: Mapping[str, Any]) -> dict[str, object]:
    x, y, z = (*value["position"], 0.0)[:3]
    half = float(value.get("heading", 0.0)) / 2
    return {"position": [x, y, z], "orientation": value.get("orientation", [0.0, 0.0, math.sin(half), math.cos(half)])}


def _covariance(value: Mapping[str, Any], name: str) -> list[float]:
    given = value.get(name)
    if given is None:
        return [UNKNOWN if row == column else 0.0 for row in range(6) for column in range(6)]
    numbers = [float(number) for row in given for number in _row(row)]
    if len(numbers) != 36:
        raise ValueError(f"{name} has {len(numbers)} numbers: expected 36, of x, y, z and the rotations about them")
    return numbers


def _row(row: Any) -> Any:
    """A row of a matrix, or one number of a flat list."""
    return row if hasattr(row, "__iter__") else (row,)


_MAKERS: dict[str, dict[str, Make]] = {
    "pose": {
        "geometry_msgs/msg/PoseStamped": _pose,
        "geometry_msgs/msg/PoseWithCovarianceStamped": _pose_with_covariance,
    },
    "odometry": {
        "nav_msgs/msg/Odometry": _odometry,
        "geometry_msgs/msg/PoseStamped": _pose,
        "geometry_msgs/msg/Twist": _twist,
        "geometry_msgs/msg/TwistStamped": _twist_stamped,
    },
    "scan": {"sensor_msgs/msg/LaserScan": _scan},
    "picture": {"sensor_msgs/msg/CompressedImage": _picture},
}
