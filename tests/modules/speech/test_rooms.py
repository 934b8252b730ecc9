"""Rooms and noise: what is said stays where it is, and sound without speech is loud, finite and the same each time."""

from __future__ import annotations

import numpy as np
import pytest

from modules.speech.rooms import LOUDNESS, in_a_room, without_speech
from modules.speech.spectrum import RATE


@pytest.mark.parametrize("seed", range(5))
def test_a_room_keeps_the_times(seed):
    click = np.zeros(RATE)
    click[8000:8100] = 10_000
    heard = in_a_room(click, np.random.default_rng(seed))
    assert len(heard) == RATE
    assert abs(int(np.abs(heard).argmax()) - 8050) < 400


@pytest.mark.parametrize("seed", range(12))  # each kind of sound several times
def test_sound_without_speech_is_as_loud_as_a_voice(seed):
    sound, again = (without_speech(1.5, np.random.default_rng(seed)) for _ in range(2))
    assert len(sound) == 1.5 * RATE
    assert np.sqrt(np.mean(sound**2)) == pytest.approx(LOUDNESS, rel=0.2)
    assert np.array_equal(sound, again)
