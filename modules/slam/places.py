"""Place recognition: which keyframes look like this picture, by a bag of binary words.

A word is a choice of bits of an ORB descriptor; each descriptor gives one word per vocabulary. Descriptors of the same
corner differ in a few bits, so with several vocabularies most share some word (locality-sensitive hashing). Such words
need no training, unlike clusters of descriptors (Galvez-Lopez and Tardos 2012), and are as good for any building.
Rare words are more informative than frequent ones: they are weighted by the inverse document frequency.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from modules.slam.features import Descriptors
    from modules.slam.geometry import Floats

    Words = NDArray[np.intp]

VOCABULARIES, BITS = 6, 13
SIZE = VOCABULARIES << BITS
SEED = 1


class Places:
    """Which words each keyframe has: 6 KiB for each."""

    def __init__(self) -> None:
        rng = np.random.default_rng(SEED)
        self._bits = np.stack([rng.choice(256, BITS, replace=False) for _ in range(VOCABULARIES)])
        self._present: dict[int, NDArray[np.uint8]] = {}
        self._frequency = np.zeros(SIZE)

    def add(self, number: int, descriptors: Descriptors) -> None:
        """Remember what a keyframe looks like."""
        present = self._bag(descriptors)
        self._present[number] = np.packbits(present)
        self._frequency += present

    def forget(self, number: int) -> None:
        """Forget a keyframe."""
        self._frequency -= np.unpackbits(self._present.pop(number))

    def alike(self, descriptors: Descriptors, among: Iterable[int], count: int) -> list[int]:
        """At most `count` of these keyframes, those that look most like the picture first."""
        numbers = [number for number in among if number in self._present]
        if not numbers or not len(descriptors):
            return []
        words = np.flatnonzero(self._bag(descriptors))
        rarity = np.log1p(len(self._present) / np.maximum(self._frequency[words], 1))
        likeness = np.array([self._shared(number, words) @ rarity for number in numbers])
        return [numbers[index] for index in np.argsort(-likeness, kind="stable")[:count]]

    def _shared(self, number: int, words: Words) -> Floats:
        """1 for each of the words that a keyframe has, else 0."""
        found: Floats = ((self._present[number][words >> 3] >> (7 - (words & 7))) & 1).astype(np.float64)
        return found

    def _bag(self, descriptors: Descriptors) -> NDArray[np.bool_]:
        """Which of all words a picture has."""
        bits = np.unpackbits(descriptors, axis=1)[:, self._bits]
        words = bits @ (1 << np.arange(BITS)) + (np.arange(VOCABULARIES) << BITS)
        present = np.zeros(SIZE, np.bool_)
        present[words.ravel()] = True
        return present
