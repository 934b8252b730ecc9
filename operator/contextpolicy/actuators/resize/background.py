"""What takes long runs on a worker's thread; what it found out is told on the loop's thread."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable
    from concurrent.futures import Executor

    from reactivex.abc import SchedulerBase

Result = TypeVar("Result")


class Background:
    """The way from the loop to the workers and back."""

    def __init__(self, scheduler: SchedulerBase, workers: Executor) -> None:
        self._scheduler, self._workers = scheduler, workers

    def run(self, work: Callable[[], Result], then: Callable[[Result], None]) -> None:
        """Do `work`, which must not raise, on a worker; then tell the loop its result."""
        self._workers.submit(self._run, work, then)

    def now(self) -> float:
        """The loop's time in seconds."""
        return self._scheduler.to_seconds(self._scheduler.now)

    def _run(self, work: Callable[[], Result], then: Callable[[Result], None]) -> None:
        result = work()
        self._scheduler.schedule(lambda *_: then(result))
