"""Text becomes a WAV file; needs Debian's flite."""

from __future__ import annotations

import io
import json
import shutil
import sys
import wave

import pytest

from modules.voice.flite import Flite, Player
from modules.voice.task import Voice
from robotkit import ConfigurationError, DeviceError, MessageError, Received

needs_flite = pytest.mark.skipif(shutil.which("flite") is None, reason="flite is not installed")


def say(voice, message):
    return list(voice.process(Received(json.dumps(message).encode(), 0, 0, "text")))


@needs_flite
def test_a_text_is_published_and_played(tmp_path):
    copy = "import sys, pathlib; pathlib.Path(sys.argv[1]).write_bytes(sys.stdin.buffer.read())"
    played = tmp_path / "played.wav"
    (result,) = say(Voice(Flite(), Player([sys.executable, "-c", copy, str(played)])), {"text": "-hello; `robot`"})
    assert result.output == "speech"
    assert played.read_bytes() == result.value
    with wave.open(io.BytesIO(result.value)) as sound:
        assert (sound.getframerate(), sound.getsampwidth(), sound.getnchannels()) == (16_000, 2, 1)
        assert 0.3 < sound.getnframes() / 16_000 < 5


@needs_flite
def test_an_endless_text_is_cut():
    wav = Flite().speak("word " * 2000)
    assert len(wav) / 32_000 < 60


@needs_flite
def test_nothing_is_spoken_without_a_text():
    assert say(Voice(Flite(), Player([])), {"text": "  "}) == []


@needs_flite
@pytest.mark.parametrize("message", [{}, [], {"text": 5}])
def test_a_message_without_text_is_refused(message):
    with pytest.raises(MessageError):
        say(Voice(Flite(), Player([])), message)


@needs_flite
def test_an_unknown_voice_is_refused():
    with pytest.raises(ConfigurationError, match="invalid value 'hal': expected slt"):
        Flite("hal")


def test_missing_flite_is_reported(monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(ConfigurationError, match="install Debian's package flite"):
        Flite()


def test_a_player_that_is_missing_is_reported_at_the_start():
    with pytest.raises(ConfigurationError, match="program 'no-such-player' not found"):
        Player(["no-such-player"])


def test_a_player_that_fails_is_a_device_error():
    with pytest.raises(DeviceError, match="failed"):
        Player([sys.executable, "-c", "raise SystemExit('no loudspeaker')"]).play(b"")
