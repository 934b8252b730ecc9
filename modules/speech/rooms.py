"""Rooms and microphones: speech with echo and noise, and sound without speech."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from modules.speech.spectrum import RATE

if TYPE_CHECKING:
    from modules.speech.spectrum import Samples

LOUDNESS = 1500.0
"""Of sound in which nobody speaks, as the root of its mean square: that of the voices."""


def in_a_room(speech: Samples, rng: np.random.Generator) -> Samples:
    """Put speech into a room with an echo and noise, before a microphone that may clip; its times stay."""
    sound = _echo(speech, rng) if rng.random() < 0.6 else speech
    sound = _coloured(sound, rng)
    loudness = np.sqrt(np.mean(speech**2))
    noise = _noise(len(sound), rng) * loudness * 10 ** (-rng.uniform(4, 40) / 20)
    sound = (sound + noise) * rng.choice([0.3, 1, 1, 2, 6])
    clipped: Samples = np.clip(sound, -32768, 32767)
    return clipped


def without_speech(seconds: float, rng: np.random.Generator) -> Samples:
    """Noise that comes and goes like syllables, knocks, or tones of a melody; each loud enough to pass for a voice."""
    kinds = (_swelling, _knocks, _melody)
    sound = kinds[rng.integers(len(kinds))](round(seconds * RATE), rng)
    background = _noise(len(sound), rng) * 10 ** (-rng.uniform(10, 40) / 20)
    loud: Samples = (sound / max(np.sqrt(np.mean(sound**2)), 1e-9) + background) * LOUDNESS
    return loud


def _swelling(length: int, rng: np.random.Generator) -> Samples:
    """Noise with 2 to 8 swells a second."""
    times = np.arange(length) / RATE
    swells = np.sin(np.pi * rng.uniform(2, 8) * times + rng.uniform(0, 3)) ** 2
    swollen: Samples = _noise(length, rng) * swells ** rng.uniform(0.5, 4)
    return swollen


def _knocks(length: int, rng: np.random.Generator) -> Samples:
    """Steps, doors, dishes: up to six a second, each dying away within 10 to 200 ms."""
    sound = np.zeros(length)
    for start in rng.integers(0, length, rng.integers(1, 2 + 6 * length // RATE)):
        times = np.arange(length - start) / RATE
        knock = rng.normal(0, 1, len(times)) + np.sin(2 * np.pi * rng.uniform(80, 3000) * times)
        sound[start:] += knock * np.exp(-times * 3 / rng.uniform(0.01, 0.2)) * rng.uniform(0.2, 1)
    return sound


def _melody(length: int, rng: np.random.Generator) -> Samples:
    """Notes with eight harmonics, each 0.1 to 0.5 s long."""
    sound = np.zeros(length)
    start = 0
    while start < length:
        note = np.arange(min(round(rng.uniform(0.1, 0.5) * RATE), length - start)) / RATE
        pitch, fall = rng.uniform(80, 600), rng.uniform(0.3, 0.9)
        tones = [fall**n * np.sin(2 * np.pi * pitch * (n + 1) * note) for n in range(8) if pitch * (n + 1) < RATE / 2]
        sound[start : start + len(note)] = np.sum(tones, axis=0) * np.exp(-note * rng.uniform(0, 8))
        start += len(note)
    return sound


def _echo(sound: Samples, rng: np.random.Generator) -> Samples:
    """Reflections die away by 60 dB within 0.1 s (a small room) to 0.6 s (a hall)."""
    decay = rng.uniform(0.1, 0.6)
    times = np.arange(round(decay * RATE)) / RATE
    response = rng.normal(0, 0.02 * rng.uniform(0.2, 1.5), len(times)) * 10 ** (-3 * times / decay)
    response[0] = 1
    size = _fast(len(sound) + len(response))
    echoed: Samples = np.fft.irfft(np.fft.rfft(sound, size) * np.fft.rfft(response, size), size)[: len(sound)]
    return echoed


def _coloured(sound: Samples, rng: np.random.Generator) -> Samples:
    """A microphone favours some frequencies: by up to 6 dB, changing slowly over the spectrum."""
    spectrum = np.fft.rfft(sound, _fast(len(sound)))
    corners = rng.uniform(-6, 6, 7)
    gain = np.interp(np.linspace(0, 1, len(spectrum)), np.linspace(0, 1, len(corners)), corners)
    coloured: Samples = np.fft.irfft(spectrum * 10 ** (gain / 20))[: len(sound)]
    return coloured


def _noise(length: int, rng: np.random.Generator) -> Samples:
    """Noise of power 1 whose spectrum falls with frequency: white (0), pink (1) or a rumble (2)."""
    size = _fast(length)
    spectrum = np.fft.rfft(rng.normal(0, 1, size))
    slope = rng.uniform(0, 2)
    spectrum *= np.maximum(np.arange(len(spectrum)), 20 * size / RATE) ** (-slope / 2)
    noise = np.fft.irfft(spectrum)[:length]
    even: Samples = noise / np.sqrt(np.mean(noise**2))
    return even


def _fast(length: int) -> int:
    """The next power of two: the Fourier transform of a prime length takes ten times as long."""
    return 1 << (length - 1).bit_length()
