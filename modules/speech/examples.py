"""What the verifier's networks learn from: stretches of synthesised sound that the spotter marks, and some others."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import repeat
from multiprocessing import get_context
from typing import TYPE_CHECKING

import numpy as np

from modules.speech.phones import PhoneModel
from modules.speech.rooms import in_a_room, without_speech
from modules.speech.spectrum import RATE
from modules.speech.spotter import KEYWORDS, Spotter
from modules.speech.verifier import views

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from numpy.typing import NDArray

    from modules.speech.corpus import Spoken
    from modules.speech.spectrum import Samples
    from modules.speech.spotter import Mark
    from modules.speech.verifier import Array

    Labels = NDArray[np.int64]

LABELS = ("other", *KEYWORDS)

_SPOTTER = {keyword: min(threshold, 1e-30) for keyword, threshold in KEYWORDS.items()}
"""More is marked than when the module runs."""
_MARGIN_S = 0.35
_ROOMS = 3
"""How often a command is heard, each time in another room."""
_JITTER_S = 0.055
_SAME = 0.5
"""A mark belongs to the command when it shares at least this part of what both cover."""
_WITHOUT_SPEECH_S = 4.0
_BATCH = 25


@dataclass(frozen=True, slots=True)
class Stretch:
    """A stretch of an utterance, in s, with the index of its label; `marked` is one that the spotter found."""

    start: float
    end: float
    label: int = 0
    marked: bool = True


@dataclass(frozen=True)
class Examples:
    """What each of the two networks sees, a row each, the index of its label in LABELS, and whether it was marked."""

    views: tuple[Array, Array]
    labels: Labels
    marked: NDArray[np.bool_]


class Examiner:
    """Makes examples of spoken texts and of other sound: where the spotter would look, and elsewhere."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._model = PhoneModel()
        self._spotter = Spotter(_SPOTTER)

    def command(self, spoken: Spoken) -> Iterator[tuple[Array, Array, Stretch]]:
        """Both views of the command, and of what else is marked, in several rooms."""
        speech = np.pad(spoken.samples(), round(_MARGIN_S * RATE))
        stretches = self._around_command(spoken, len(speech) / RATE, self._spotter.spot(speech))
        for _ in range(_ROOMS if stretches else 0):
            cut = self._rng.uniform(0, _MARGIN_S * 0.7)
            yield from self._seen(in_a_room(speech[round(cut * RATE) :], self._rng), stretches, cut)

    def other(self, spoken: Spoken | None) -> Iterator[tuple[Array, Array, Stretch]]:
        """Both views of what is marked in speech without a command or in other sound, and of more stretches."""
        if spoken:
            sound = in_a_room(np.pad(spoken.samples(), round(_MARGIN_S * RATE)), self._rng)
        else:
            sound = without_speech(_WITHOUT_SPEECH_S, self._rng)
        found = [Stretch(mark.start, mark.end) for mark in self._spotter.spot(sound)]
        seconds = len(sound) / RATE
        middles = self._rng.uniform(_MARGIN_S, seconds - _MARGIN_S, 2 + int(seconds))
        halves = self._rng.uniform(0.1, 0.35, len(middles))
        found += [Stretch(m - half, m + half, marked=False) for m, half in zip(middles, halves, strict=True)]
        yield from self._seen(sound, found)

    def _around_command(self, spoken: Spoken, seconds: float, marks: list[Mark]) -> list[Stretch]:
        label = LABELS.index(spoken.keyword or "")
        mine = next((Stretch(m.start, m.end, label) for m in marks if m.keyword == spoken.keyword), None)
        if mine is None and spoken.text == spoken.keyword:  # alone, it is in the middle
            mine = Stretch(seconds / 2 - 0.2, seconds / 2 + 0.2, label)
        if mine is None:
            return []
        others = [Stretch(m.start, m.end) for m in marks if m.keyword != spoken.keyword and _shared(m, mine) < _SAME]
        return [mine, mine, *others]  # each is moved a little, so the two differ

    def _seen(self, sound: Samples, stretches: list[Stretch], cut: float = 0) -> Iterator[tuple[Array, Array, Stretch]]:
        posteriors = self._model.posteriors(sound)
        for stretch in stretches:
            early, late = self._rng.uniform(-_JITTER_S, _JITTER_S, 2) - cut
            yield *views(posteriors, stretch.start + early, stretch.end + late), stretch


def examine(texts: Iterable[Spoken | None], seed: int, progress: Callable[[int], None]) -> Examples:
    """Synthesise the texts, and sound without speech for each None, and gather their examples; all cores work on it."""
    found: list[Examples] = []
    done = 0
    everything = tuple(texts)
    batches = [everything[start : start + _BATCH] for start in range(0, len(everything), _BATCH)]
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:  # what started threads must not be forked
        for batch, one in zip(batches, pool.map(_examine, batches, repeat(seed), range(len(batches))), strict=True):
            found.append(one)
            done += len(batch)
            progress(done)
    first, second = (np.concatenate([one.views[index] for one in found]) for index in (0, 1))
    labels, marked = (np.concatenate([getattr(one, name) for one in found]) for name in ("labels", "marked"))
    return Examples((first, second), labels, marked)


def _examine(batch: tuple[Spoken | None, ...], seed: int, index: int) -> Examples:
    """Some of the texts, in another process; the same whichever process it is."""
    examiner = Examiner(np.random.default_rng([seed, index]))
    found = [
        example
        for spoken in batch
        for example in (examiner.command(spoken) if spoken and spoken.keyword else examiner.other(spoken))
    ]
    seconds, marks, stretches = zip(*found, strict=True)
    labels = np.array([stretch.label for stretch in stretches])
    return Examples((np.array(seconds), np.array(marks)), labels, np.array([stretch.marked for stretch in stretches]))


def _shared(mark: Mark, stretch: Stretch) -> float:
    """The part that both cover of what either covers."""
    both = min(mark.end, stretch.end) - max(mark.start, stretch.start)
    return max(both, 0) / (max(mark.end, stretch.end) - min(mark.start, stretch.start))
