"""Samples of latched topics (transient_local in ROS 2), which publishers keep for those who subscribe later.

A publisher may publish once, to nobody; rmw_zenoh makes it one of Zenoh's advanced publishers, which answer queries for
their last sample. Zenoh's advanced subscriber would ask them, but it keeps a place for each sender that there ever was,
and senders choose who they seem to be, with each sample if they like. Here a few places are kept, and lost ones cost no
more than hearing a sample twice.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from threading import Lock
from typing import TYPE_CHECKING, Any

import zenoh

from contextpolicy.streams.direct import directly

if TYPE_CHECKING:
    from collections.abc import Callable

    from reactivex.abc import SchedulerBase

PAUSE = 1.0
"""Seconds between two questions at least: publishers may appear without pause."""
PATIENCE = 5.0
"""Seconds in which publishers answer."""
MOST_KEYS = 64
"""Keys of a stream whose last sample is remembered."""


def subscribe_latched(
    session: zenoh.Session, key: str, take: Callable[[zenoh.Sample], None], scheduler: SchedulerBase
) -> Callable[[], None]:
    """Have `take` called with live samples, and with those that publishers kept; call the result to end it.

    It is called on Zenoh's threads. Live samples do not wait for kept ones.
    """
    own, newest = zenoh.KeyExpr(key), Newest()

    def on_sample(sample: zenoh.Sample) -> None:
        newest.note(str(sample.key_expr), sample.timestamp)
        take(sample)

    def on_reply(reply: zenoh.Reply) -> None:
        kept = reply.ok
        # Replies are on the keys of samples, and not on those that were asked for, so Zenoh checks none.
        if kept is not None and own.intersects(kept.key_expr) and newest.admit(str(kept.key_expr), kept.timestamp):
            take(kept)

    question = _Question(session, f"{key}/@adv/**?_max=1", scheduler, directly(on_reply))
    declared: list[Any] = [
        session.declare_subscriber(key, directly(on_sample)),
        session.liveliness().declare_subscriber(f"{key}/@adv/pub/**", directly(question.on_token), history=True),
    ]
    question.ask()

    def end() -> None:
        question.end()
        for one in declared:
            one.undeclare()

    return end


class Newest:
    """When the last sample of each key was published, of the keys heard last; may be used by any thread."""

    def __init__(self) -> None:
        self._stamps: OrderedDict[int, zenoh.Timestamp | None] = OrderedDict()
        self._lock = Lock()

    def note(self, key: str, stamp: zenoh.Timestamp | None) -> None:
        """A sample was received live: nothing older is of interest."""
        with self._lock:
            self._put(hash(key), stamp)

    def admit(self, key: str, stamp: zenoh.Timestamp | None) -> bool:
        """Whether a kept sample is newer than what was heard of its key; it is noted if so."""
        place = hash(key)
        with self._lock:
            if place in self._stamps:
                known = self._stamps[place]
                if known is None or stamp is None or known >= stamp:
                    return False
            self._put(place, stamp)
            return True

    def _put(self, place: int, stamp: zenoh.Timestamp | None) -> None:
        self._stamps[place] = stamp
        self._stamps.move_to_end(place)
        if len(self._stamps) > MOST_KEYS:
            self._stamps.popitem(last=False)


class _Question:
    """Asks all publishers for what they keep: at once, and all of them again when another one appears."""

    def __init__(
        self,
        session: zenoh.Session,
        selector: str,
        scheduler: SchedulerBase,
        answers: zenoh.handlers.Callback[zenoh.Reply],
    ) -> None:
        self._session, self._selector, self._answers = session, selector, answers
        self._scheduler = scheduler
        self._lock = Lock()
        self._waiting = self._ended = False
        self._asked_at = -math.inf

    def on_token(self, token: zenoh.Sample) -> None:
        """A publisher appears, or ends; called on a Zenoh thread, which must not call Zenoh."""
        if token.kind == zenoh.SampleKind.PUT:
            self.ask()

    def ask(self) -> None:
        """Ask soon, from the loop; called on any thread."""
        with self._lock:
            if self._waiting or self._ended:
                return
            self._waiting = True
        rest = self._asked_at + PAUSE - self._now()
        self._scheduler.schedule_relative(max(0.0, rest), self._ask)

    def end(self) -> None:
        """Stop asking."""
        self._ended = True

    def _ask(self, *_: object) -> None:
        with self._lock:
            self._waiting, self._asked_at = False, self._now()
        if not self._ended:
            self._session.get(
                self._selector,
                self._answers,
                # Of publishers that claim to know all, Zenoh would ask one alone.
                target=zenoh.QueryTarget.ALL,
                # Else it keeps all replies until the last has come.
                consolidation=zenoh.ConsolidationMode.NONE,
                accept_replies=zenoh.ReplyKeyExpr.ANY,
                congestion_control=zenoh.CongestionControl.DROP,
                timeout=PATIENCE,
            )

    def _now(self) -> float:
        return self._scheduler.to_seconds(self._scheduler.now)
