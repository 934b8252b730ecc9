"""One source, several subscribers, one thread."""

from __future__ import annotations

import pytest
from reactivex import Observable, Subject, of
from reactivex.disposable import Disposable, SerialDisposable

from contextpolicy.streams.sharing import share_on_loop


def counted():
    """A subject, shared, and what happens to its subscription."""
    subject: Subject[int] = Subject()
    events: list[str] = []

    def subscribe(observer, _=None):
        events.append("subscribed")
        inner = subject.subscribe(observer)

        def leave():
            events.append("disposed")
            inner.dispose()

        return Disposable(leave)

    return subject, events, share_on_loop(Observable(subscribe))


def test_all_get_each_item_in_the_order_in_which_they_subscribed():
    subject, events, shared = counted()
    seen: list[object] = []
    shared.subscribe(lambda item: seen.append(("first", item)))
    shared.subscribe(lambda item: seen.append(("second", item)))
    subject.on_next(1)
    assert seen == [("first", 1), ("second", 1)]
    assert events == ["subscribed"]


def test_the_source_is_disposed_with_the_last_subscriber():
    subject, events, shared = counted()
    seen: list[object] = []
    one, other = shared.subscribe(seen.append), shared.subscribe()
    one.dispose()
    subject.on_next(1)
    assert (seen, events) == ([], ["subscribed"])
    other.dispose()
    assert events == ["subscribed", "disposed"]


def test_unsubscribing_during_emission_does_not_affect_others():
    subject, _, shared = counted()
    seen: list[int] = []
    leaving = SerialDisposable()
    leaving.disposable = shared.subscribe(lambda _: leaving.dispose())
    shared.subscribe(seen.append)
    subject.on_next(1)
    assert seen == [1]


def test_the_end_and_errors_reach_all():
    ends: list[str] = []
    shared = share_on_loop(of(1))
    shared.subscribe(on_completed=lambda: ends.append("end"))
    assert ends == ["end"]
    subject, _, shared = counted()
    for _ in range(2):
        shared.subscribe(on_error=lambda error: ends.append(str(error)))
    subject.on_error(ValueError("broken"))
    assert ends == ["end", "broken", "broken"]


def test_a_subscribers_error_reaches_the_emitter():
    subject, _, shared = counted()
    shared.subscribe(lambda _: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        subject.on_next(1)
    with pytest.raises(ZeroDivisionError):
        subject.on_next(2)
