"""What a module's author writes: one class that turns samples into results, or produces results by itself."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    import threading
    from collections.abc import Iterator

    from robotkit.inputs import Received
    from robotkit.plan import Decision


@dataclass(frozen=True, slots=True)
class Result:
    """A value for one of the module's outputs: a mapping for `json` and `cdr`, bytes for every other encoding.

    `stamp`, in ns since 1970, is when the value was true; by default the stamp of the sample that led to it (of a ROS
    message its header's), or now.
    """

    output: str
    value: Mapping[str, object] | bytes
    stamp: int | None = None


Results: TypeAlias = Mapping[str, object] | Iterable[Result] | None
"""A mapping is for a module with one output; None means that there is nothing to publish."""


class Task:
    """A robot's task; override what it needs. `process` and `produce` run on threads of their own."""

    def process(self, received: Received) -> Results:
        """Turn one sample into results. MessageError drops the sample; so does DeviceError, counted as a failure."""
        raise NotImplementedError(f"{type(self).__name__} takes inputs, so it must override process()")

    def produce(self, ended: threading.Event) -> Iterator[Result]:
        """Yield results unasked, as sensors do, until `ended` is set; wait with `ended.wait(seconds)`.

        Called when the task starts and each time it is resumed. When it is suspended or stopped, `ended` is set and the
        generator closed, so release the device in `finally`. After a DeviceError it is called again later.
        """
        del ended
        yield from ()

    def set_quality(self, quality: float) -> None:
        """Do as much for an input as `quality` says: 1 is all, 0.1 a tenth; called before `process`, on its thread.

        It changes with how late the results are (`quality.Quality`), and never with `ADAPT=false`.
        """

    def adapt(self, decision: Decision) -> None:
        """Adapt to a new decision, after the task was suspended or before it is resumed, on the plan listener's thread.

        `decision.share` is None when no plan binds the task. DeviceError is counted as a failure; any other exception
        ends the module.
        """

    def close(self) -> None:
        """Make the robot safe; called last, within a second after SIGTERM. Exceptions are treated as in `adapt`."""
