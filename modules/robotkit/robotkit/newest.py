"""A stream's newest sample, for who subscribes just after it was published: the answer to a query for its key."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import zenoh


class Newest:
    """Keeps what was published last on one key."""

    def __init__(self, session: zenoh.Session, key: str, encoding: zenoh.Encoding) -> None:
        self._key, self._encoding = key, encoding
        self._kept: tuple[bytes, bytes] | None = None
        self._queryable = session.declare_queryable(key, self._answer)

    def keep(self, payload: bytes, attachment: bytes) -> None:
        """Note what was just published; the caller must not change it later."""
        self._kept = payload, attachment

    def close(self) -> None:
        """Answer no more."""
        self._queryable.undeclare()

    def _answer(self, query: zenoh.Query) -> None:
        kept = self._kept
        with query:
            if kept is not None:
                query.reply(self._key, kept[0], encoding=self._encoding, attachment=kept[1])
