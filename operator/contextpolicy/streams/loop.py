"""The one thread on which everything is decided: an Rx scheduler whose clock never steps.

Rx's own event loop wakes its thread through a condition variable and wraps each action three times. With a sample every
few milliseconds that costs more than deciding about it; a queue written in C costs half as much.
"""

from __future__ import annotations

import heapq
import itertools
import logging
import time
from concurrent.futures import Future
from datetime import UTC, datetime, timedelta
from queue import Empty, SimpleQueue
from threading import Thread
from typing import TYPE_CHECKING, Any, TypeVar

from reactivex.abc import DisposableBase
from reactivex.scheduler.periodicscheduler import PeriodicScheduler

if TYPE_CHECKING:
    from collections.abc import Callable

    from reactivex.abc import SchedulerBase

Answer = TypeVar("Answer")

log = logging.getLogger(__name__)

FEW = 64
"""Actions that arrive at least between two searches for those that were cancelled."""


class Loop(PeriodicScheduler):
    """Takes the wall clock's time at start, then follows the monotonic clock, so setting the clock moves no timer.

    Actions run in the order of the times that they are scheduled for. One that raises is logged; the loop goes on.
    """

    def __init__(self) -> None:
        super().__init__()
        self._started = datetime.now(UTC)
        self._origin = time.monotonic()
        self._arriving: SimpleQueue[tuple[float, int, _Action] | None] = SimpleQueue()
        self._waiting: list[tuple[float, int, _Action]] = []
        self._tidy_at = FEW
        self._numbers = itertools.count()
        self._disposed = False
        Thread(target=self._run, name="loop", daemon=True).start()

    @property
    def now(self) -> datetime:
        """The loop's time."""
        return self._started + timedelta(seconds=time.monotonic() - self._origin)

    def schedule(self, action: Callable[..., Any], state: Any = None) -> DisposableBase:
        """Run an action as soon as possible; may be called from any thread, as all of these."""
        return self._put(time.monotonic(), action, state)

    def schedule_relative(self, duetime: Any, action: Callable[..., Any], state: Any = None) -> DisposableBase:
        """Run an action after some time."""
        return self._put(time.monotonic() + max(0.0, self.to_seconds(duetime)), action, state)

    def schedule_absolute(self, duetime: Any, action: Callable[..., Any], state: Any = None) -> DisposableBase:
        """Run an action at a time of this loop's clock."""
        due = self._origin + (self.to_datetime(duetime) - self._started).total_seconds()
        return self._put(max(due, time.monotonic()), action, state)

    def dispose(self) -> None:
        """End the thread; whatever still waits is abandoned."""
        self._disposed = True
        self._arriving.put(None)

    def _put(self, due: float, action: Callable[..., Any], state: Any) -> DisposableBase:
        if self._disposed:
            raise RuntimeError("the loop has ended")
        item = _Action(self, action, state)
        self._arriving.put((due, next(self._numbers), item))
        return item

    def _run(self) -> None:
        waiting = self._waiting
        while not self._disposed:
            self._wait()
            while waiting and waiting[0][0] <= time.monotonic() and not self._disposed:
                heapq.heappop(waiting)[2].run()
                self._take_arrived()

    def _wait(self) -> None:
        """Wait until an action is due or another arrives."""
        waiting = self._waiting
        try:
            entry = self._arriving.get(timeout=max(0.0, waiting[0][0] - time.monotonic()) if waiting else None)
        except Empty:
            return
        self._sort_in(entry)
        self._take_arrived()

    def _take_arrived(self) -> None:
        arriving = self._arriving
        while not arriving.empty():  # no other consumer
            self._sort_in(arriving.get_nowait())

    def _sort_in(self, entry: tuple[float, int, _Action] | None) -> None:
        if entry is not None:
            heapq.heappush(self._waiting, entry)
            if entry[1] >= self._tidy_at:
                self._tidy(entry[1])

    def _tidy(self, number: int) -> None:
        """Drop what was cancelled: a far timer that each sample sets again would wait once for every sample.

        Next after as many actions as are left, so its cost per action is constant.
        """
        self._waiting[:] = [entry for entry in self._waiting if not entry[2].cancelled]
        heapq.heapify(self._waiting)
        self._tidy_at = number + max(FEW, len(self._waiting))


def on_loop(loop: SchedulerBase, action: Callable[[], Answer]) -> Future[Answer]:
    """Run `action` on the loop, from any thread; what it raises reaches the future and the loop's log."""
    future: Future[Answer] = Future()

    def run(*_: object) -> None:
        awaited = future.set_running_or_notify_cancel()
        try:
            answer = action()
        except Exception as error:
            if awaited:
                future.set_exception(error)
            raise  # the loop logs it and goes on
        if awaited:
            future.set_result(answer)

    loop.schedule(run)
    return future


class _Action(DisposableBase):
    """Something scheduled; disposing of it, on any thread, cancels it and whatever it scheduled in turn."""

    __slots__ = ("_action", "_loop", "_nested", "_state", "cancelled")

    def __init__(self, loop: Loop, action: Callable[..., Any], state: Any) -> None:
        self._loop, self._action, self._state = loop, action, state
        self._nested: Any = None
        self.cancelled = False

    def run(self) -> None:
        if self.cancelled:
            return
        try:
            self._nested = self._action(self._loop, self._state)
        except Exception:
            log.exception("internal error")
        if self.cancelled:
            self.dispose()

    def dispose(self) -> None:
        self.cancelled = True
        if isinstance(self._nested, DisposableBase):
            self._nested.dispose()
