"""From microphone chunks to text."""

from __future__ import annotations

from typing import TYPE_CHECKING

from modules.speech.gate import Gate
from modules.speech.sound import SoundStream
from robotkit import Result, Task

if TYPE_CHECKING:
    from modules.transcript.engines import Engine
    from robotkit import Received

LONGEST_S = 10.0


class Transcript(Task):
    """Publishes the spoken text, utterance by utterance; an utterance ends with 0.3 s of silence."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._sound = SoundStream(Gate(longest=LONGEST_S, overlap=0))

    def process(self, received: Received) -> list[Result]:
        """Give the text of each utterance that ended, with the time of its beginning in s since 1970."""
        results = []
        for utterance in self._sound.feed(received):
            text = self._engine.transcribe(utterance.samples)
            if text:
                at = self._sound.time_of(utterance.start)
                results.append(Result("transcript", {"text": text, "final": True, "at": at}))
        return results
