"""One reading of a stream."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Sample:
    """A decoded payload; `timestamp` is when it was taken, where the sender tells, in seconds of the planner's time.

    `arrived` is when it reached the operator, on the monotonic clock: planning decides nothing by it and hands it on to
    the plan, so that what follows can say how long the robot took to react.
    """

    stream: str
    value: dict[str, Any]
    timestamp: float | None = None
    arrived: float | None = None


def as_fields(decoded: object) -> dict[str, Any]:
    """A payload as CEL sees it: a map stays a map, anything else is read as `stream.value`."""
    if isinstance(decoded, dict):
        return decoded
    return {"value": decoded}
