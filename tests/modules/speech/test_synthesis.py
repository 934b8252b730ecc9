from __future__ import annotations

import shutil

import numpy as np
import pytest

from modules.speech.synthesis import PEAK, SpeechError, speak
from tests.modules.sounds import needs_voices


@needs_voices
def test_a_voice_is_as_loud_as_the_others():
    assert np.abs(speak("stop now", "slt")).max() == pytest.approx(PEAK)


def test_a_missing_program_is_named(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with pytest.raises(SpeechError, match="flite is missing: install"):
        speak("stop now", "slt")
