"""A subscriber that may fail: others on the same path don't notice, and it gets its item again.

An exception that Rx passes up through a shared source keeps the item from all subscribers after this one, and from
what the source has still to do.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, TypeVar

from reactivex.disposable import CompositeDisposable, Disposable, SerialDisposable

if TYPE_CHECKING:
    from collections.abc import Callable

    from reactivex import Observable
    from reactivex.abc import DisposableBase, SchedulerBase

Item = TypeVar("Item")

log = logging.getLogger(__name__)

RETRY = 1.0
"""Seconds until a subscriber that failed gets its item again, unless a newer one comes first."""


def persist(source: Observable[Item], act: Callable[[Item], None], scheduler: SchedulerBase) -> DisposableBase:
    """Have `act` called with each item; when it raises, that is logged, and it is called again until it succeeds.

    Disposing of the result ends that, too.
    """
    timer = SerialDisposable()
    failed = False

    def on_next(item: Item) -> None:
        nonlocal failed
        if failed:
            failed, timer.disposable = False, Disposable()
        try:
            act(item)
        except Exception:
            log.exception("internal error; next attempt in %g s", RETRY)
            failed, timer.disposable = True, scheduler.schedule_relative(RETRY, lambda *_: on_next(item))

    return CompositeDisposable(source.subscribe(on_next), timer)
