"""Counts the operator's Python calls on all threads."""

from __future__ import annotations

import sys
import threading
import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import contextpolicy

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import FrameType

OPERATOR = str(Path(contextpolicy.__file__).parents[1])
TESTS = str(Path(__file__).parents[1])
QUIET = 0.08
"""Seconds without a call after which all threads are taken to wait. The next thing that is due is the status, 0.1 s
after the plan; on a busy machine a thread that could go on may wait for most of that."""


class Call(NamedTuple):
    """When it began, in monotonic seconds, and the file of the function that was called."""

    at: float
    file: str


class CallCounter:
    """Notes calls between `start` and `stop`, on this thread and on those that begin once it exists.

    A call is the operator's if, of the frames that belong to the operator or to the tests, the innermost is the
    operator's: what a library does counts as its caller's. Where there is none, as on an executor's thread, it is the
    operator's too.
    """

    def __init__(self) -> None:
        self._calls: list[Call] = []
        self._counting = False
        threading.setprofile(self._on_event)
        sys.setprofile(self._on_event)

    def start(self) -> None:
        """Begin at zero."""
        self._calls = []
        self._counting = True

    def so_far(self) -> int:
        """The number of calls since the start."""
        return len(self._calls)

    def stop(self) -> list[Call]:
        """All calls since the start."""
        self._counting = False
        return self._calls

    def _on_event(self, frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and self._counting and _is_operators(frame):
            # What a dataclass generates has no file of its own, but the globals of the module that defines the class.
            self._calls.append(Call(time.monotonic(), frame.f_globals.get("__file__") or frame.f_code.co_filename))


def until_quiet(calls: Sequence[Call], after: int) -> int:
    """How many calls there are before all threads wait for the first time since so many calls."""
    gaps = (n for n in range(max(after, 1), len(calls)) if calls[n].at - calls[n - 1].at > QUIET)
    return next(gaps, len(calls))


def by_file(calls: Sequence[Call]) -> Counter[str]:
    """The number of calls of each file's functions."""
    return Counter(call.file for call in calls)


def own(calls: Sequence[Call]) -> list[Call]:
    """Those of the operator's own functions."""
    return [call for call in calls if call.file.startswith(OPERATOR)]


def shown(file: str) -> str:
    """A file as people call it: relative to where Python found it."""
    roots = sorted((f"{root}/" for root in sys.path if root), key=len, reverse=True)
    return next((file.removeprefix(root) for root in roots if file.startswith(root)), file)


def _is_operators(frame: FrameType | None) -> bool:
    while frame is not None:
        file = frame.f_code.co_filename
        if file.startswith((OPERATOR, TESTS)):
            return file.startswith(OPERATOR)
        frame = frame.f_back
    return True
