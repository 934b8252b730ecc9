"""The timing of each sample that is done, for experiments: all of them, for who asks on `robot/<task>/runs`.

Published as they happen they would cost the task, and a bus that is short of CPU would lose some.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import zenoh

from robotkit import json_text

if TYPE_CHECKING:
    from collections.abc import Mapping


class RunLog:
    """Grows as long as the task runs."""

    def __init__(self, session: zenoh.Session, task: str) -> None:
        self._key = f"robot/{task}/runs"
        self._timings: list[Mapping[str, Any]] = []
        self._queryable = session.declare_queryable(self._key, self._answer)

    def add(self, timing: Mapping[str, Any]) -> None:
        """Note that a sample is done."""
        self._timings.append(timing)

    def close(self) -> None:
        """Answer no more."""
        self._queryable.undeclare()

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            query.reply(self._key, json_text.dumps(list(self._timings)), encoding=zenoh.Encoding.APPLICATION_JSON)
