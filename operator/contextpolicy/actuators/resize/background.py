"""Run slow work on a worker's thread, and handle its result on the loop's thread."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable
    from concurrent.futures import Executor

    from reactivex.abc import SchedulerBase

Result = TypeVar("Result")


class Background:
    """The bridge from the loop to the workers and back."""

    def __init__(self, scheduler: SchedulerBase, workers: Executor) -> None:
        self._scheduler, self._workers = scheduler, workers

    def run(self, work: Callable[[], Result], then: Callable[[Result], None]) -> None:
        """Call `work`, which must not raise, on a worker; then call `then` with its result on the loop."""
        self._workers.submit(self._run, work, then)

    def now(self) -> float:
        """The loop's time in seconds."""
        return self._scheduler.to_seconds(self._scheduler.now)

    def _run(self, work: Callable[[], Result], then: Callable[[Result], None]) -> None:
        result = work()
        self._scheduler.schedule(lambda *_: then(result))
