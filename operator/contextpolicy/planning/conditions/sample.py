"""One reading of a stream."""

from __future__ import annotations

from typing import Any, NamedTuple


class Sample(NamedTuple):
    """A decoded payload; `timestamp` is when it was taken, if the sender says so, in seconds on the planner's clock.

    `arrived` is when it reached the operator, in seconds on the monotonic clock: planning never decides by it, only
    passes it on to the plan, so that the reaction time can be measured. `key` is the key that it came under, where the
    stream's has wildcards.
    """

    stream: str
    value: dict[str, Any]
    timestamp: float | None = None
    arrived: float | None = None
    key: str = ""


def as_fields(decoded: object) -> dict[str, Any]:
    """A payload as CEL sees it: a map stays a map, anything else is read as `stream.value`."""
    if isinstance(decoded, dict):
        return decoded
    return {"value": decoded}
