"""Words that sound like a command or like a part of one, found by their phones in PocketSphinx's dictionary.

How close a word comes is the edit distance (Wagner and Fischer 1974) between the command and the stretch of the word
that is most like it, so that "afford" and "shoreward" are both close to "forward".
"""

from __future__ import annotations

import re
from functools import cache
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pocketsphinx import get_model_path

if TYPE_CHECKING:
    from numpy.typing import NDArray

COMMANDS = {
    "forward": "F AO R W ER D",
    "backward": "B AE K W ER D",
    "left": "L EH F T",
    "right": "R AY T",
    "stop": "S T AA P",
}
"""Their phones in the dictionary."""

_ALIKE = (
    "AA AE AH AO AW OW",
    "AE AY EH EY",
    "EY IH IY",
    "ER OY UH UW W",
    "B P",
    "D T",
    "G K",
    "CH JH S SH TH Z ZH",
    "DH F HH V",
    "M N NG",
    "L R W Y",
)
"""Phones that are mistaken for each other; to swap two of a row costs half as much as any other change."""
_LONGEST = 10
_CHANGE, _SWAP, _IMPOSSIBLE = 1.0, 0.5, 99.0


@cache
def dictionary() -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """All words of up to ten phones, written with letters only, and their phones."""
    lines = Path(get_model_path(), "en-us/cmudict-en-us.dict").read_text(encoding="utf-8").splitlines()
    entries = [(word, tuple(phones)) for word, *phones in map(str.split, lines)]
    chosen = [entry for entry in entries if re.fullmatch("[a-z]{2,}", entry[0]) and len(entry[1]) <= _LONGEST]
    words, phones = zip(*chosen, strict=True)
    return words, phones


@cache
def confusable(command: str, count: int) -> tuple[str, ...]:
    """The words that come closest to a command and hold none: the closest first, of equals the shortest."""
    words, phones = dictionary()
    distances = _distances(COMMANDS[command].split(), phones)
    order = np.lexsort((np.array([len(one) for one in phones]), distances)).tolist()
    return tuple(islice((words[index] for index in order if not holds_command(words[index])), count))


def holds_command(word: str) -> bool:
    """Whether a word contains the sound of a command, such as "copyright" and "stopped"."""
    return word in _holding()


@cache
def _holding() -> frozenset[str]:
    words, phones = dictionary()
    spoken = [f" {' '.join(one)} " for one in phones]
    commands = [f" {one} " for one in COMMANDS.values()]
    return frozenset(word for word, one in zip(words, spoken, strict=True) if any(each in one for each in commands))


def _distances(command: list[str], phones: tuple[tuple[str, ...], ...]) -> NDArray[np.float64]:
    """The distance of each word, all words at once: a row of the table for each phone of the command."""
    names = sorted({phone for one in phones for phone in one})
    table = np.full((len(phones), _LONGEST), len(names))
    for row, one in zip(table, phones, strict=True):
        row[: len(one)] = [names.index(phone) for phone in one]
    before = np.zeros((len(phones), _LONGEST + 1))  # a match may begin anywhere in the word
    for phone in command:
        costs = np.array([*(_cost(phone, name) for name in names), _IMPOSSIBLE])[table]
        after = np.empty_like(before)
        after[:, 0] = before[:, 0] + _CHANGE
        for column in range(_LONGEST):
            shorter = np.minimum(before[:, column + 1], after[:, column]) + _CHANGE
            after[:, column + 1] = np.minimum(before[:, column] + costs[:, column], shorter)
        before = after
    distances: NDArray[np.float64] = before.min(axis=1)  # and end anywhere
    return distances


def _cost(phone: str, other: str) -> float:
    if phone == other:
        return 0
    return _SWAP if any({phone, other} <= set(row.split()) for row in _ALIKE) else _CHANGE
