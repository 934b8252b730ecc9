"""What is learned from, what thresholds are chosen on, and what is held out.

By speaker where the file's name has the speaker, else by source. A source is what one group of people published
together, with their microphones: all recordings of a folder that is given by name, so the folder's name should be the
source's own.
"""

from __future__ import annotations

import re
import zlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

PARTS = ("held-out", "tuning", "training")
_HELD_OUT_OF = 3
"""A third of all speakers and sources is held out."""
_TUNING_OF = 9
"""A ninth is for the choice of thresholds."""
_SPEAKERS = (
    re.compile(r"(?P<speaker>.+)_nohash_\d+"),  # Speech Commands: 0a7c2a8d_nohash_0
    re.compile(r"(?P<speaker>\d+)-\d+-\d+"),  # LibriSpeech: 103-1240-0000
)


def part(name: str) -> str:
    """The part of a speaker or a source: held out if its CRC-32 divides by 3, for tuning if it is 1 more than 9 n."""
    number = zlib.crc32(name.encode())
    if number % _HELD_OUT_OF == 0:
        return "held-out"
    return "tuning" if number % _TUNING_OF == 1 else "training"


def voice(path: Path, source: str) -> str:
    """Whose recording it is: the speaker in the file's name, or else its source, for all its speakers."""
    matches = (pattern.fullmatch(path.stem) for pattern in _SPEAKERS)
    return next((match["speaker"] for match in matches if match), source)


def belongs(path: Path, source: Path, wanted: str | None) -> bool:
    """Whether a recording of a source's folder is of the wanted part; without one all are."""
    return wanted is None or part(voice(path, source.resolve().stem)) == wanted
