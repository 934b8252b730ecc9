"""Sound for tests: files of 16 bit and one channel, and a mark for what needs programs that speak."""

from __future__ import annotations

import shutil
import wave

import pytest

needs_voices = pytest.mark.skipif(
    shutil.which("flite") is None or shutil.which("sox") is None, reason="flite and sox are not installed"
)


def write(path, samples, rate=16_000):
    path.parent.mkdir(parents=True, exist_ok=True)
    with wave.open(str(path), "wb") as file:
        file.setparams((1, 2, rate, 0, "NONE", "not compressed"))
        file.writeframes(samples.astype("<i2").tobytes())
    return path
