"""`python -m modules.speech.training`: synthesises speech, trains the verifier's networks on it, writes their weights.

README.md says how long it takes, on one core, and which of Debian's packages speak.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from modules.speech.corpus import in_a_room, script
from modules.speech.phones import PhoneModel
from modules.speech.spectrum import RATE
from modules.speech.spotter import KEYWORDS, Spotter
from modules.speech.verifier import INPUTS, WEIGHTS, Network, Verifier, views

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from numpy.typing import NDArray

    from modules.speech.corpus import Spoken
    from modules.speech.spectrum import Samples
    from modules.speech.verifier import Array

    Labels = NDArray[np.int64]
    Layers = list[list[Array]]

LABELS = ("other", *KEYWORDS)

_MARGIN_S = 0.35
_ROOMS, _ROOMS_OTHER = 3, 1
"""How often a command, and how often any other text is heard, each time in another room."""
_JITTER_S = 0.055
_HIDDEN = 96
_EPOCHS = 12
_LEARNING_RATE = 1e-3
_DECAY = 1e-4
_DROPOUT = 0.25
_BATCH = 128


@dataclass(frozen=True)
class Stretch:
    """A stretch of an utterance, in s, with the index of its label."""

    start: float
    end: float
    label: int


@dataclass(frozen=True)
class Examples:
    """What each of the two networks sees, a row each, with the index of its label in LABELS."""

    views: tuple[Array, Array]
    labels: Labels


class Examiner:
    """Makes examples of spoken texts: where the spotter would look, and elsewhere."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._model = PhoneModel()
        self._spotter = Spotter(dict.fromkeys(KEYWORDS, 1e-30))

    def examples(self, spoken: Spoken) -> Iterator[tuple[Array, Array, int]]:
        """Both views of one utterance's stretches in several rooms, with their label."""
        speech = np.pad(spoken.samples(), round(_MARGIN_S * RATE))
        stretches = self._stretches(spoken, speech)
        rooms = _ROOMS if spoken.keyword else _ROOMS_OTHER
        for _ in range(rooms if stretches else 0):
            cut = self._rng.uniform(0, _MARGIN_S * 0.7)
            posteriors = self._model.posteriors(in_a_room(speech[round(cut * RATE) :], self._rng))
            for stretch in stretches:
                early, late = self._rng.uniform(-_JITTER_S, _JITTER_S, 2) - cut
                yield *views(posteriors, stretch.start + early, stretch.end + late), stretch.label

    def _stretches(self, spoken: Spoken, speech: Samples) -> list[Stretch]:
        """Where to look, and what is there: a command where the spotter finds it, else other speech."""
        marks = self._spotter.spot(speech)
        seconds = len(speech) / RATE
        if spoken.keyword is None:
            found = [Stretch(mark.start, mark.end, 0) for mark in marks]
            middles = self._rng.uniform(_MARGIN_S, seconds - _MARGIN_S, 2 + 2 * int(seconds))
            halves = self._rng.uniform(0.1, 0.35, len(middles))
            return found + [Stretch(m - half, m + half, 0) for m, half in zip(middles, halves, strict=True)]
        label = LABELS.index(spoken.keyword)
        found = [Stretch(mark.start, mark.end, label) for mark in marks if mark.keyword == spoken.keyword]
        if not found and spoken.text == spoken.keyword:  # alone, it is in the middle
            found = [Stretch(seconds / 2 - 0.2, seconds / 2 + 0.2, label)]
        return found[:1] * 2  # each is moved a little, so these are two


def examine(texts: Iterable[Spoken], seed: int, progress: Callable[[int], None]) -> Examples:
    """Synthesise the texts and gather their examples."""
    examiner = Examiner(np.random.default_rng(seed))
    found: list[tuple[Array, Array, int]] = []
    for index, spoken in enumerate(texts):
        found += examiner.examples(spoken)
        progress(index + 1)
    seconds, marks, labels = zip(*found, strict=True)
    return Examples((np.array(seconds), np.array(marks)), np.array(labels))


def train(examples: Examples, *, epochs: int = _EPOCHS) -> Verifier:
    """Fit a network to each view."""
    first, second = (fit(seen, examples.labels, epochs=epochs) for seen in examples.views)
    return Verifier(LABELS, (first, second))


def fit(seen: Array, labels: Labels, *, epochs: int, seed: int = 1) -> Network:
    """Minimise the cross-entropy with Adam (Kingma and Ba 2015), dropout, and a rate that falls to 0 as a cosine."""
    rng = np.random.default_rng(seed)
    layers: Layers = [
        [rng.normal(0, np.sqrt(2 / rows), (rows, columns)).astype(np.float32), np.zeros(columns, np.float32)]
        for rows, columns in pairwise((INPUTS, _HIDDEN, len(LABELS)))
    ]
    weights = _weights(labels)
    adam = _Adam([array for layer in layers for array in layer])
    for epoch in range(epochs):
        rate = _LEARNING_RATE * 0.5 * (1 + np.cos(np.pi * epoch / epochs))
        for chosen in np.array_split(rng.permutation(len(labels)), -(-len(labels) // _BATCH)):
            truth = labels[chosen]
            adam.step(_gradients(layers, seen[chosen], truth, weights[truth], rng), rate)
    return Network(tuple((matrix, bias) for matrix, bias in layers))


def _weights(labels: Labels) -> Array:
    """What an example counts, by label: commands together as much as all that is none."""
    counts = np.bincount(labels, minlength=len(LABELS))
    parts = np.array([0.5, *[0.5 / len(KEYWORDS)] * len(KEYWORDS)])
    return (parts * len(labels) / np.maximum(counts, 1)).astype(np.float32)


def _gradients(layers: Layers, seen: Array, labels: Labels, weights: Array, rng: np.random.Generator) -> list[Array]:
    """Backpropagation of the weighted cross-entropy, in the order of the layers: matrix, bias, matrix, bias."""
    inputs = []
    values = seen
    for index, (matrix, bias) in enumerate(layers):
        kept = rng.random(values.shape, np.float32) >= _DROPOUT
        inputs.append(np.where(kept, values / np.float32(1 - _DROPOUT), np.float32(0)))
        values = inputs[-1] @ matrix + bias
        if index < len(layers) - 1:
            values = np.maximum(values, 0)
    likely = np.exp(values - values.max(axis=1, keepdims=True))
    likely /= likely.sum(axis=1, keepdims=True)
    likely[np.arange(len(labels)), labels] -= 1
    error = likely * (weights / np.float32(len(labels)))[:, None]
    gradients: list[Array] = []
    for (matrix, _), values in zip(reversed(layers), reversed(inputs), strict=True):
        gradients[:0] = [values.T @ error + np.float32(_DECAY) * matrix, error.sum(axis=0)]
        error = error @ matrix.T * (values > 0) / np.float32(1 - _DROPOUT)
    return gradients


class _Adam:
    """Changes the parameters in place."""

    def __init__(self, parameters: list[Array]) -> None:
        self._parameters = parameters
        self._means = [np.zeros_like(parameter) for parameter in parameters]
        self._squares = [np.zeros_like(parameter) for parameter in parameters]
        self._steps = 0

    def step(self, gradients: list[Array], rate: float) -> None:
        self._steps += 1
        mean_scale, square_scale = 1 - 0.9**self._steps, 1 - 0.999**self._steps
        parts = zip(self._parameters, self._means, self._squares, gradients, strict=True)
        for parameter, mean, square, gradient in parts:
            mean[...] = 0.9 * mean + 0.1 * gradient
            square[...] = 0.999 * square + 0.001 * gradient**2
            parameter[...] -= rate * (mean / mean_scale) / (np.sqrt(square / square_scale) + 1e-8)


def main() -> int:
    """Train and save."""
    parser = argparse.ArgumentParser(prog="python -m modules.speech.training", description=__doc__)
    parser.add_argument("--output", type=Path, default=WEIGHTS)
    parser.add_argument("--scale", type=float, default=0.7, help="how much to synthesise (0.7: 2000 utterances)")
    parser.add_argument("--seed", type=int, default=7)
    options = parser.parse_args()
    texts = list(script(np.random.default_rng(options.seed), options.scale))

    def progress(done: int) -> None:
        if done % 100 == 0 or done == len(texts):
            sys.stderr.write(f"{done} of {len(texts)} utterances\n")

    examples = examine(texts, options.seed, progress)
    counts = np.bincount(examples.labels, minlength=len(LABELS))
    sys.stderr.write(f"examples: {dict(zip(LABELS, counts.tolist(), strict=True))}\n")
    train(examples).save(options.output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
