"""An Rx operator that limits how often something that may change with every sample goes on.

Rx's own `throttle_first` never emits the last item of a burst, `debounce` delays the first, and `sample` ticks without
news. Leading and trailing edge need an operator of our own.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Generic, TypeVar

from reactivex import Observable
from reactivex.disposable import CompositeDisposable, Disposable, SerialDisposable

if TYPE_CHECKING:
    from collections.abc import Callable

    from reactivex.abc import DisposableBase, ObserverBase, SchedulerBase

Item = TypeVar("Item")


def pace(
    interval: float, scheduler: SchedulerBase, *, at_once: Callable[[Item], bool] = lambda _: False
) -> Callable[[Observable[Item]], Observable[Item]]:
    """Emit the first item at once, then the newest at most every `interval` seconds; no timer runs without items.

    An item that must go `at_once` takes the place of the one that waits, and the interval begins again.
    """

    def operator(source: Observable[Item]) -> Observable[Item]:
        def subscribe(observer: ObserverBase[Item], _: SchedulerBase | None = None) -> DisposableBase:
            pacing = _Pacing(observer, interval, scheduler, at_once)
            subscription = source.subscribe(pacing.on_next, observer.on_error, pacing.on_completed)
            return CompositeDisposable(subscription, pacing.timer)

        return Observable(subscribe)

    return operator


class _Pacing(Generic[Item]):
    """One subscription."""

    def __init__(
        self,
        observer: ObserverBase[Item],
        interval: float,
        scheduler: SchedulerBase,
        at_once: Callable[[Item], bool],
    ) -> None:
        self.timer = SerialDisposable()
        self._observer, self._interval, self._scheduler, self._at_once = observer, interval, scheduler, at_once
        self._waiting: list[Item] = []
        """The newest item, while the interval lasts."""
        self._over = -math.inf
        """When the interval is over."""

    def on_next(self, item: Item) -> None:
        now = self._scheduler.to_seconds(self._scheduler.now)
        if now >= self._over or self._at_once(item):
            self._emit(item, now)
        elif self._waiting:
            self._waiting[0] = item
        else:
            self._waiting.append(item)
            self.timer.disposable = self._scheduler.schedule_relative(self._over - now, self._on_time)

    def on_completed(self) -> None:
        self.timer.dispose()
        for item in self._waiting:
            self._observer.on_next(item)
        self._observer.on_completed()

    def _on_time(self, *_: object) -> None:
        [item] = self._waiting
        self._emit(item, self._scheduler.to_seconds(self._scheduler.now))

    def _emit(self, item: Item, now: float) -> None:
        self._over = now + self._interval
        if self._waiting:
            self._waiting.clear()
            self.timer.disposable = Disposable()
        self._observer.on_next(item)
