"""Which senders of a stream are alive, by their liveliness tokens."""

from __future__ import annotations

from threading import Lock
from typing import TYPE_CHECKING, Any, Protocol

import zenoh
from zenoh.handlers import Callback

from contextpolicy.streams.direct import directly

if TYPE_CHECKING:
    from collections.abc import Callable

PATIENCE = 1.0
"""Seconds to wait for who is alive at the start; until then none is the last to end."""
LONGEST = 1024
"""Characters of a token's key; those of ROS 2 have some 200. A longer one says nothing."""
MOST = 1000
"""Tokens that are known at once; who comes beyond that counts once another has ended."""


class SendersListener(Protocol):
    """Receives changes of a stream's senders; called on Zenoh's threads, and must not block them."""

    def on_gone(self) -> None:
        """The last of them ended."""


class Senders:
    """The tokens that live.

    Who lives at the start is asked for, and the answers come on another thread than what changes meanwhile: a token may
    end before it is reported. Zenoh's own `history` says no more than that there is a token, whether or not it ended.
    """

    def __init__(self, listener: SendersListener) -> None:
        self._listener = listener
        self._lock = Lock()
        self._alive: set[str] = set()
        self._ended: set[str] = set()
        """The tokens that ended while the answers were still to come."""
        self._complete = False

    def on_token(self, token: zenoh.Sample) -> None:
        """A token appears, or ends."""
        key = str(token.key_expr)
        with self._lock:
            if token.kind == zenoh.SampleKind.PUT:
                _note(self._alive, key)
                self._ended.discard(key)
                return
            known = key in self._alive
            self._alive.discard(key)
            if not self._complete:
                _note(self._ended, key)
            gone = self._complete and known and not self._alive
        if gone:
            self._listener.on_gone()

    def on_answer(self, reply: zenoh.Reply) -> None:
        """A token lived when it was asked for."""
        if reply.ok is None:
            return
        key = str(reply.ok.key_expr)
        with self._lock:
            if key not in self._ended:
                _note(self._alive, key)

    def on_end(self) -> None:
        """The answers are complete."""
        with self._lock:
            gone = bool(self._ended) and not self._alive
            self._complete = True
            self._ended.clear()
        if gone:
            self._listener.on_gone()


def _note(tokens: set[str], key: str) -> None:
    if len(key) <= LONGEST and len(tokens) < MOST:
        tokens.add(key)


def follow_senders(session: zenoh.Session, tokens: str, listener: SendersListener) -> Callable[[], None]:
    """Follow the tokens of this key expression; call the result to end it."""
    senders = Senders(listener)
    subscriber: Any = session.liveliness().declare_subscriber(tokens, directly(senders.on_token))
    answers = Callback(senders.on_answer, senders.on_end, indirect=False)
    session.liveliness().get(tokens, answers, timeout=PATIENCE)
    undeclare: Callable[[], None] = subscriber.undeclare
    return undeclare
