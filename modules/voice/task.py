"""From text to speech."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotkit import MessageError, Result, Task, json_text

if TYPE_CHECKING:
    from collections.abc import Iterator

    from modules.voice.flite import Flite, Player
    from robotkit import Received


class Voice(Task):
    """Publishes each text as a WAV file, then plays it where there is a loudspeaker."""

    def __init__(self, flite: Flite, player: Player) -> None:
        self._flite = flite
        self._player = player

    def process(self, received: Received) -> Iterator[Result]:
        """Speak one text; the next one waits until it has been played."""
        text = _text(received.payload)
        return self._spoken(text) if text else iter(())

    def _spoken(self, text: str) -> Iterator[Result]:
        wav = self._flite.speak(text)
        yield Result("speech", wav)
        self._player.play(wav)


def _text(payload: bytes) -> str:
    try:
        message = json_text.loads(payload)
        text = message["text"]
    except (ValueError, KeyError, TypeError) as error:
        raise MessageError(f"not an object with the field text: {error!r}") from error
    if not isinstance(text, str):
        raise MessageError(f"text: invalid value {text!r}: expected a string")
    return text.strip()
