from __future__ import annotations

import numpy as np
import pytest

from timelines.datasets import speech
from timelines.datasets.speech import every_command


def test_every_voice_says_every_command_without_overlap():
    script = every_command(("rms", "slt"))
    assert len(script.utterances) == 2 * len(speech.COMMANDS)
    starts = [utterance.at for utterance in script.utterances]
    assert set(np.diff(starts).round(9)) == {1.8}
    assert starts[-1] + 1.8 == pytest.approx(script.duration)
