"""What the networks learn from: words that people said, speech without commands, and synthesised speech."""

from __future__ import annotations

from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from modules.speech.corpus import Spoken
from modules.speech.gate import Gate
from modules.speech.keywords import KEYWORDS
from modules.speech.phones import PhoneModel
from modules.speech.rooms import in_a_room, without_speech
from modules.speech.spectrum import RATE
from modules.speech.speech_commands import Clip, between_silences, chunks, load
from modules.speech.windows import COLUMNS_PER_SECOND, WIDTH, columns, stretches

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from numpy.typing import ArrayLike, NDArray

    from modules.speech.spectrum import Samples
    from modules.speech.windows import Array

    Labels = NDArray[np.int64]

LABELS = ("other", *KEYWORDS)
CONTEXT = WIDTH + 36
"""Columns of an example: training draws a window from within it."""

Word: TypeAlias = Clip | Spoken


@dataclass(frozen=True, slots=True)
class Phrase:
    """Words said one after the other; the one at `place` is taught, as a command or as another word."""

    words: tuple[Word, ...]
    place: int


Sound: TypeAlias = Clip | Spoken | Phrase | Path | None
"""A person's word; a synthesised text; words in a row; a recording without commands; or None for no speech."""

_ENOUGH = 1300
"""Examples of a command by people: with fewer clips each is heard several times, in other rooms and at other speeds."""
_OFTEN = 25
_SPEEDS = 0.85, 1.18
_PIECE_S = 0.44
"""Seconds between the examples of connected speech."""
_ELSEWHERE = 0.4
"""The part of connected speech and of other words that is heard in another room."""
_WITHOUT_SPEECH_S = 4.0
_SILENCE_S = 0.25
"""Before and after a word: about as much as the gate leaves."""
_LEAST_BESIDE_S, _MOST_BESIDE_S = 0.03, 0.12
"""What is kept before and after the loud part of a word in a phrase: a faint consonant, or a pause."""
_LOUDNESS_OF_WORDS = 1500.0, 4000.0
"""Of the words of a phrase, as the root of the mean square."""
_FRAME = RATE // 100
_BATCH = 25


@dataclass(frozen=True)
class Examples:
    """Columns around what was said, (examples, CONTEXT, SEEN), and the index of its label in LABELS."""

    seen: NDArray[np.float16]
    labels: Labels


class Examiner:
    """Makes examples, the same for the same seed."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._model = PhoneModel()
        self._gate = Gate()

    def examples(self, sound: Sound, times: int) -> Iterator[tuple[Array, int]]:
        """The columns and labels of one sound, whose word is heard so many times."""
        match sound:
            case Clip(path, word):
                yield from self._word(load(path), _label(word), times)
            case Spoken(text, keyword) if text == keyword:
                yield from self._word(sound.samples(), _label(text), times)
            case Spoken(keyword=str(command)):
                yield from self._taught(*within(sound), _label(command), times)
            case Phrase():
                yield from self._phrase(sound)
            case Spoken():
                yield from self._speech(np.pad(sound.samples(), RATE))
            case None:
                yield from self._speech(without_speech(_WITHOUT_SPEECH_S, self._rng))
            case _:
                yield from self._speech(load(sound))

    def _word(self, samples: Samples, label: int, times: int) -> Iterator[tuple[Array, int]]:
        """A word by itself, each time but the first at another speed in another room."""
        for time in range(times):
            said = at_speed(samples, self._rng.uniform(*_SPEEDS)) if time else samples
            moved = bool(time) or (label == 0 and self._rng.random() < _ELSEWHERE)
            heard = between_silences(said, _SILENCE_S)
            yield from self._around(heard, [middle(heard)], label, moved=moved)

    def _taught(self, samples: Samples, place: float, label: int, times: int) -> Iterator[tuple[Array, int]]:
        """A command within a phrase, whose middle is at `place` s; each time but the first in another room."""
        heard = between_silences(samples, _SILENCE_S)
        for time in range(times):
            yield from self._around(heard, [place + _SILENCE_S], label, moved=bool(time))

    def _phrase(self, phrase: Phrase) -> Iterator[tuple[Array, int]]:
        """Words of about the same loudness, one after the other with little or nothing in between."""
        said = [self._spoken(word) for word in phrase.words]
        before = np.concatenate([np.empty(0), *said[: phrase.place]])
        place = (len(before) + len(said[phrase.place]) / 2) / RATE
        word = phrase.words[phrase.place]
        label = _label(word.word if isinstance(word, Clip) else word.text)
        heard = between_silences(np.concatenate(said), _SILENCE_S)
        yield from self._around(heard, [place + _SILENCE_S], label, moved=self._rng.random() < _ELSEWHERE)

    def _spoken(self, word: Word) -> Samples:
        """A word without the silence around it, but for a bit that differs."""
        samples = at_speed(_samples(word), self._rng.uniform(*_SPEEDS))
        start, end = extent(samples)
        beside = self._rng.uniform(_LEAST_BESIDE_S, _MOST_BESIDE_S, 2)
        cut = samples[max(round((start - beside[0]) * RATE), 0) : round((end + beside[1]) * RATE)]
        loudness = self._rng.uniform(*_LOUDNESS_OF_WORDS)
        loud: Samples = cut * (loudness / max(np.sqrt(np.mean(cut**2)), 1))
        return loud

    def _speech(self, samples: Samples) -> Iterator[tuple[Array, int]]:
        """Pieces of what passes the gate."""
        self._gate.restart()
        for utterance in (one for chunk in chunks(samples) for one in self._gate.feed(chunk)):
            start, seconds = self._rng.uniform(0, _PIECE_S), len(utterance.samples) / RATE
            moved = self._rng.random() < _ELSEWHERE
            yield from self._around(utterance.samples, np.arange(start, seconds, _PIECE_S), 0, moved=moved)

    def _around(self, samples: Samples, middles: ArrayLike, label: int, *, moved: bool) -> Iterator[tuple[Array, int]]:
        seen = columns(in_a_room(samples, self._rng) if moved else samples, self._model)
        places = np.round(np.asarray(middles) * COLUMNS_PER_SECOND).astype(int)
        yield from ((one, label) for one in stretches(seen, places, CONTEXT))


def middle(samples: Samples) -> float:
    """Where a recording's word is, in s: half way between its beginning and its end."""
    return sum(extent(samples)) / 2


def within(spoken: Spoken) -> tuple[Samples, float]:
    """A phrase, and the middle in s of the command that begins or ends it: as long as when the voice says it alone."""
    samples = spoken.samples()
    start, end = extent(samples)
    first, last = extent(replace(spoken, text=spoken.keyword or "").samples())
    half = (last - first) / 2
    return samples, start + half if spoken.text.startswith(spoken.keyword or "") else end - half


def _samples(word: Word) -> Samples:
    return load(word.path) if isinstance(word, Clip) else word.samples()


def extent(samples: Samples) -> tuple[float, float]:
    """The first and the last moment of a recording that is loud, in s."""
    frames = samples[: len(samples) // _FRAME * _FRAME].reshape(-1, _FRAME)
    loudness = np.convolve(10 * np.log10((frames**2).mean(axis=1) + 1), np.ones(5) / 5, "same")
    loud = np.flatnonzero(loudness >= (np.percentile(loudness, 10) + loudness.max()) / 2)
    return float(loud[0]) * _FRAME / RATE, float(loud[-1] + 1) * _FRAME / RATE


def at_speed(samples: Samples, factor: float) -> Samples:
    """Faster and higher, as by a smaller speaker, or slower and lower."""
    changed: Samples = np.interp(np.arange(0, len(samples) - 1, factor), np.arange(len(samples)), samples)
    return changed


def examine(sounds: Iterable[Sound], seed: int, progress: Callable[[int], None]) -> Examples:
    """Make the examples of all sounds; all cores work on it."""
    jobs = _repeated(tuple(sounds))
    batches = [jobs[start : start + _BATCH] for start in range(0, len(jobs), _BATCH)]
    seen, labels, done = [], [], 0
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:  # what started threads must not be forked
        made = pool.map(_examine, batches, repeat(seed), range(len(batches)))
        for batch, examples in zip(batches, made, strict=True):
            seen.append(examples.seen)
            labels.append(examples.labels)
            done += len(batch)
            progress(done)
    return Examples(np.concatenate(seen), np.concatenate(labels))


def _repeated(sounds: Sequence[Sound]) -> list[tuple[Sound, int]]:
    """How often each is heard: the commands of people often enough that all count about the same."""
    counts = Counter(sound.word for sound in sounds if isinstance(sound, Clip) and sound.word in KEYWORDS)
    times = {word: min(max(round(_ENOUGH / count), 1), _OFTEN) for word, count in counts.items()}
    return [(sound, times.get(sound.word, 1) if isinstance(sound, Clip) else 2) for sound in sounds]


def _examine(batch: Sequence[tuple[Sound, int]], seed: int, index: int) -> Examples:
    """Some of the sounds, in another process; the same whichever process it is."""
    examiner = Examiner(np.random.default_rng([seed, index]))
    found = [example for sound, times in batch for example in examiner.examples(sound, times)]
    seen = np.array([one for one, _ in found], np.float16).reshape(len(found), CONTEXT, -1)
    return Examples(seen, np.array([label for _, label in found], np.int64))


def _label(word: str) -> int:
    return LABELS.index(word) if word in KEYWORDS else 0
