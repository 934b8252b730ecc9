"""From microphone chunks to keywords."""

from __future__ import annotations

from typing import TYPE_CHECKING

from modules.speech.sound import SoundStream
from robotkit import Result, Task

if TYPE_CHECKING:
    from modules.speech.listener import Listener
    from robotkit import Received


class Speech(Task):
    """Hears commands, once the utterance that they are in has ended."""

    def __init__(self, listener: Listener) -> None:
        self._listener = listener
        self._sound = SoundStream(listener.gate)

    def process(self, received: Received) -> list[Result]:
        """Give keywords with the time of their beginning in s since 1970."""
        return [
            Result(
                "keyword",
                {
                    "keyword": heard.keyword,
                    "at": self._sound.time_of(heard.start),
                    "confidence": round(heard.confidence, 3),
                },
            )
            for utterance in self._sound.feed(received)
            for heard in self._listener.listen(utterance)
        ]
