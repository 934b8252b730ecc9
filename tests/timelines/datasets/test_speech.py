from __future__ import annotations

import shutil

import numpy as np
import pytest

from timelines.datasets import speech
from timelines.datasets.speech import PEAK, SpeechError, every_command, speak


def test_every_voice_says_every_command_without_overlap():
    script = every_command(("rms", "slt"), spacing=2)
    assert len(script.utterances) == 2 * len(speech.COMMANDS)
    starts = [utterance.at for utterance in script.utterances]
    assert set(np.diff(starts).round(9)) == {2.0}
    assert starts[-1] + 2 == script.duration


@pytest.mark.skipif(shutil.which("flite") is None or shutil.which("sox") is None, reason="no flite or sox")
def test_a_voice_is_as_loud_as_the_others():
    assert np.abs(speak("stop now", "slt")).max() == pytest.approx(PEAK)


def test_a_missing_program_is_named(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with pytest.raises(SpeechError, match="flite is missing: install"):
        speak("stop now", "slt")
