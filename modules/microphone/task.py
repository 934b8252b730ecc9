"""A microphone as a task: while it is suspended, its device is closed and nothing is recorded."""

from __future__ import annotations

import math
from array import array
from typing import TYPE_CHECKING

from robotkit import Result, Task

if TYPE_CHECKING:
    import threading
    from collections.abc import Iterator

    from modules.microphone.sources import Source

LOUDEST = 32768


class Microphone(Task):
    """Publishes sound, and how loud it is: a policy reads levels, not sound."""

    def __init__(self, source: Source) -> None:
        self._source = source

    def produce(self, ended: threading.Event) -> Iterator[Result]:
        """Give each chunk with its level until the end."""
        for stamp, chunk in self._source.chunks(ended):
            yield Result("audio", chunk, stamp)
            yield Result("level", {"level": round(level(chunk), 4)}, stamp)


def level(chunk: bytes) -> float:
    """Root mean square of 16 bit samples, 1 is the loudest square wave."""
    samples = array("h", chunk)
    return math.sqrt(sum(sample * sample for sample in samples) / max(len(samples), 1)) / LOUDEST
