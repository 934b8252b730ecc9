"""Sound of other forms than 16 kHz mono: converted if its encoding names the form, noticed by its rate if not."""

from __future__ import annotations

import math
import re

import numpy as np

from modules.speech.spectrum import RATE
from robotkit import MessageError

_ENCODING = re.compile(r"pcm-s16le-(\d+(?:\.\d+)?)khz-(mono|stereo)")
_HIGHEST_HZ = 96_000
_REACH = 24
"""Samples of 16 kHz on both sides that one is interpolated from."""

OTHER_RATES = {
    32_000: "32 kHz mono or 16 kHz stereo",
    44_100: "44.1 kHz mono",
    48_000: "48 kHz mono",
    88_200: "44.1 kHz stereo",
}
"""What raw sound of another rate is, by samples a second. 96,000 may be 48 kHz stereo, but also a recording of 16 kHz
that is played at six times its pace."""
_TOLERANCE = 0.02
_WATCHED_NS = 2_000_000_000
_NEW_NS = 1_000_000_000
"""After so long a pause between two chunks the rate is measured again."""


class Converter:
    """Makes 16 kHz mono of samples of a rate (Hz) and a number of channels, chunk after chunk."""

    def __init__(self, rate: int, channels: int) -> None:
        self._channels = channels
        shared = math.gcd(rate, RATE)
        self._up, self._down = RATE // shared, rate // shared
        self._kernels = _kernels(self._up, self._down)
        self._rest = np.zeros(self._kernels.shape[1] // 2)
        self._phase = 0

    def convert(self, payload: bytes) -> bytes:
        """The next chunk, delayed by 1.5 ms."""
        if len(payload) % (2 * self._channels):
            raise MessageError(f"{len(payload)} bytes are not 16 bit samples of {self._channels} channels")
        samples = np.frombuffer(payload, "<i2").reshape(-1, self._channels).mean(axis=1)
        known = np.concatenate([self._rest, samples])
        ready = max(len(known) - self._kernels.shape[1] + 1, 0) * self._up - self._phase
        steps = self._phase + self._down * np.arange(max(-(-ready // self._down), 0))
        whole, part = np.divmod(steps, self._up)
        pieces = known[whole[:, None] + np.arange(self._kernels.shape[1])]
        following = self._phase + self._down * len(steps)
        self._rest, self._phase = known[following // self._up :], following % self._up
        mixed = np.einsum("ij,ij->i", pieces, self._kernels[part])
        rounded: bytes = np.clip(np.round(mixed), -32768, 32767).astype("<i2").tobytes()
        return rounded


class RateWatch:
    """Detects from the stamps of raw chunks whether their samples come at another rate than 16 kHz."""

    def __init__(self) -> None:
        self._first = self._last = 0
        self._count = 0
        self._problem = ""

    def check(self, stamp: int, count: int) -> None:
        """Count a chunk; MessageError while the samples of the last 2 s came at the rate of another form."""
        if not 0 <= stamp - self._last <= _NEW_NS:
            self._first, self._count, self._problem = stamp, 0, ""
        else:
            self._count += count
        self._last = stamp
        if stamp - self._first >= _WATCHED_NS:
            self._problem = _problem(self._count * 1e9 / (stamp - self._first))
            self._first, self._count = stamp, 0
        if self._problem:
            raise MessageError(self._problem)


def converter(encoding: str) -> Converter | None:
    """What converts sound of an encoding such as pcm-s16le-44.1khz-stereo; None if nothing is to be done."""
    if encoding in ("", "cdr", "pcm-s16le-16khz-mono"):
        return None
    found = _ENCODING.fullmatch(encoding)
    rate = round(float(found[1]) * 1000) if found else 0
    if not found or not RATE / 2 <= rate <= _HIGHEST_HZ:
        raise MessageError(
            f"invalid encoding {encoding!r}: expected pcm-s16le-<rate>khz-<mono|stereo> with a rate of 8 to 96, "
            "such as pcm-s16le-48khz-stereo"
        )
    return Converter(rate, 1 if found[2] == "mono" else 2)


def _problem(rate: float) -> str:
    for other, form in OTHER_RATES.items():
        if abs(rate / other - 1) < _TOLERANCE:
            return (
                f"{rate:.0f} samples a second look like {form}: expected 16 kHz, 16 bit, mono, or an encoding that "
                "names the form, such as INPUT_AUDIO='{encoding: pcm-s16le-48khz-stereo}'"
            )
    return ""


def _kernels(up: int, down: int) -> np.typing.NDArray[np.float64]:
    """A low-pass of half of the lower rate for each position between two samples: (up, width)."""
    widest = max(down / up, 1.0)
    reach = math.ceil(_REACH * widest)
    offsets = np.arange(-reach, reach + 1) - np.arange(up)[:, None] / up
    kernels = np.sinc(offsets / widest) * np.cos(np.clip(offsets / (reach + 1), -1, 1) * np.pi / 2) ** 2
    normed: np.typing.NDArray[np.float64] = kernels / kernels.sum(axis=1, keepdims=True)
    return normed
