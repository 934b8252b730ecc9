"""An instantiation function to plug in: streams in, an observable of scores out (paper IV-D).

A package makes it known with an entry point, and a policy names it:

    [project.entry-points."contextpolicy.initiatives"]
    steadiness = "my_package.initiatives:steadiness"

    activity:
    - {initiative: steadiness, with: {stream: imu}}
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from reactivex import operators as ops

if TYPE_CHECKING:
    from collections.abc import Mapping

    from reactivex import Observable
    from reactivex.abc import SchedulerBase


def steadiness(
    *,
    streams: Mapping[str, Observable[dict[str, Any]]],
    scheduler: SchedulerBase,  # noqa: ARG001 - for functions that wait
    stream: str,
) -> Observable[float]:
    """1 while the speed stays as it is, towards 0 the more it jumps from one sample to the next."""
    speeds: Observable[float] = streams[stream].pipe(ops.map(_speed))
    return speeds.pipe(ops.pairwise(), ops.map(_steadiness))


def _speed(sample: dict[str, Any]) -> float:
    return float(sample["speed"])


def _steadiness(pair: tuple[float, float]) -> float:
    return 1 / (1 + abs(pair[1] - pair[0]))
