"""`python -m modules.speech.training`: trains the networks on people's clips and synthesised speech, and saves them.

--words FOLDER...      clips of people, in folders named after words
--connected FOLDER...  their speech without commands

Of both only the speakers and sources of the training part are used (parts.py has the rule).
docs/measurements/speech.md says which of Debian's packages speak, and on what the shipped networks were trained.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from modules.speech.corpus import script
from modules.speech.examples import CONTEXT, LABELS, Phrase, examine
from modules.speech.keywords import KEYWORDS
from modules.speech.network import WEIGHTS, Committee, Layer, Network
from modules.speech.parts import belongs
from modules.speech.spectrum import BANDS
from modules.speech.speech_commands import Clip, clips, recordings
from modules.speech.windows import SEEN, WIDTH, centred

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from modules.speech.examples import Examples, Labels, Sound, Word
    from modules.speech.network import Array

_SHAPES = ((5, 2, 64), (5, 1, 64), (3, 2, 96), (9, 1, 64), (1, 1, len(LABELS)))
"""Width, stride and outputs of each layer; the fourth sees all that is left of the second."""
_COMMITTEE = 3
_DROPOUT = {3: 0.4, 4: 0.3}
"""What part of its inputs a layer loses in training."""
_JITTER = 8
"""Columns by which a command is off the middle of its window, at most."""
_HIDDEN, _HIDDEN_COLUMNS, _HIDDEN_ROWS = 0.4, 6, 3
"""How often columns and rows are hidden, and how many at most (SpecAugment: Park et al., Interspeech 2019)."""
_MOST = 4.0
"""What an example counts at most: the commands that few people said would be learned by heart."""
_EPOCHS = 10
_LEARNING_RATE, _WARM_UP = 1.5e-3, 200
_DECAY, _SMOOTHING = 1e-4, 0.05
_BATCH = 128
_WITHOUT_SPEECH = 300
"""Sounds in which nobody speaks, at scale 1."""
_PHRASES = 700
"""Phrases with each command, at scale 1."""


def train(examples: Examples, *, epochs: int = _EPOCHS, committee: int = _COMMITTEE) -> Committee:
    """Fit networks that differ by their first weights and by the order of what they see."""
    return Committee(LABELS, tuple(fit(examples, epochs=epochs, seed=seed) for seed in range(committee)))


def fit(examples: Examples, *, epochs: int, seed: int = 1) -> Network:
    """Minimise the cross-entropy with Adam (Kingma and Ba 2015), dropout, and a rate that falls to 0 as a cosine."""
    rng = np.random.default_rng(seed)
    layers, weights = _first(rng), importance(examples.labels)
    adam = _Adam([array for layer in layers for array in (layer.matrix, layer.bias)])
    batches = -(-len(examples.labels) // _BATCH)
    for step in range(epochs * batches):
        if step % batches == 0:
            order = np.array_split(rng.permutation(len(examples.labels)), batches)
        chosen = order[step % batches]
        windows = drawn(examples.seen[chosen], examples.labels[chosen], rng)
        falling = 0.5 * (1 + np.cos(np.pi * step / (epochs * batches)))
        gradients = _gradients(layers, windows, examples.labels[chosen], weights[chosen], rng)
        adam.step(gradients, _LEARNING_RATE * falling * min(1, (step + 1) / _WARM_UP))
    return Network(layers)


def importance(labels: Labels) -> Array:
    """What each example counts: all commands alike, together as much as all else; the mean is 1."""
    counts = np.bincount(labels, minlength=len(LABELS))
    parts = np.array([0.5, *[0.5 / (len(LABELS) - 1)] * (len(LABELS) - 1)])
    weights = np.minimum(parts * len(labels) / np.maximum(counts, 1), _MOST)[labels]
    even: Array = (weights / weights.mean()).astype(np.float32)
    return even


def drawn(seen: NDArray[np.float16], labels: Labels, rng: np.random.Generator) -> Array:
    """A window of each example: near the middle of a command, anywhere in what is none; some of it is hidden."""
    farthest = (CONTEXT - WIDTH) // 2
    reach = np.where(labels > 0, _JITTER, farthest)
    starts = farthest + rng.integers(-reach, reach + 1)
    places = starts[:, None] + np.arange(WIDTH)
    windows = centred(seen[np.arange(len(seen))[:, None], places].astype(np.float32))
    for window in windows:
        _hide(window, _HIDDEN_COLUMNS, rng)
        _hide(window.T[:BANDS], _HIDDEN_ROWS, rng)
        _hide(window.T[BANDS:], _HIDDEN_ROWS, rng)
    return windows


def _hide(rows: Array, most: int, rng: np.random.Generator) -> None:
    if rng.random() < _HIDDEN:
        start = rng.integers(0, len(rows) - most)
        rows[start : start + rng.integers(1, most + 1)] = 0


def _first(rng: np.random.Generator) -> tuple[Layer, ...]:
    layers: list[Layer] = []
    inputs = SEEN
    for width, stride, outputs in _SHAPES:
        matrix = rng.normal(0, np.sqrt(2 / (width * inputs)), (width, inputs, outputs)).astype(np.float32)
        layers.append(Layer(matrix, np.zeros(outputs, np.float32), stride))
        inputs = outputs
    return tuple(layers)


def _gradients(
    layers: tuple[Layer, ...], windows: Array, labels: Labels, weights: Array, rng: np.random.Generator
) -> list[Array]:
    """Backpropagation of the weighted cross-entropy, in the order of the layers: matrix, bias, matrix, bias."""
    passed = []
    values = windows
    for index, layer in enumerate(layers):
        through = (values > 0).astype(np.float32)
        if lost := _DROPOUT.get(index):
            through *= (rng.random(values.shape, np.float32) >= lost) / np.float32(1 - lost)
            values = values * through
        stretches = layer.stretches(values)
        passed.append((layer, through, stretches))
        values = stretches @ layer.matrix.reshape(-1, layer.matrix.shape[2]) + layer.bias
        if index < len(layers) - 1:
            values = np.maximum(values, 0)
    error = _error(values[:, 0], labels, weights)[:, None]
    gradients: list[Array] = []
    for layer, through, stretches in reversed(passed):
        flat = error.reshape(-1, error.shape[2])
        matrix = (stretches.reshape(len(flat), -1).T @ flat).reshape(layer.matrix.shape)
        gradients[:0] = [matrix + np.float32(_DECAY) * layer.matrix, flat.sum(axis=0)]
        error = _spread(layer, error, through.shape) * through
    return gradients


def _error(scores: Array, labels: Labels, weights: Array) -> Array:
    """What the softmax says too much of each label; labels are smoothed, as some clips are wrong."""
    likely = np.exp(scores - scores.max(axis=1, keepdims=True))
    likely /= likely.sum(axis=1, keepdims=True)
    likely[np.arange(len(labels)), labels] -= 1 - _SMOOTHING
    error: Array = (likely - np.float32(_SMOOTHING / len(LABELS))) * (weights / np.float32(len(labels)))[:, None]
    return error


def _spread(layer: Layer, error: Array, shape: tuple[int, ...]) -> Array:
    """A layer's error as its inputs share it: each place gives to the columns that it sees."""
    windows, places, _ = error.shape
    width, inputs, outputs = layer.matrix.shape
    shares = (error @ layer.matrix.reshape(-1, outputs).T).reshape(windows, places, width, inputs)
    spread = np.zeros(shape, np.float32)
    for column in range(width):
        spread[:, column : column + layer.stride * (places - 1) + 1 : layer.stride] += shares[:, :, column]
    return spread


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
    parser = argparse.ArgumentParser(
        prog="python -m modules.speech.training",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--words", type=Path, nargs="+", default=[])
    parser.add_argument("--connected", type=Path, nargs="+", default=[])
    parser.add_argument("--output", type=Path, default=WEIGHTS)
    parser.add_argument("--scale", type=float, default=0.5, help="how much to synthesise (0.5: 1400 texts)")
    parser.add_argument("--seed", type=int, default=7)
    options = parser.parse_args()
    sounds = [*_sounds(options)]

    def progress(done: int) -> None:
        sys.stderr.write(f"{done} of {len(sounds)} sounds\n")

    examples = examine(sounds, options.seed, progress)
    counts = np.bincount(examples.labels, minlength=len(LABELS))
    sys.stderr.write(f"examples: {dict(zip(LABELS, counts.tolist(), strict=True))}\n")
    train(examples).save(options.output)
    return 0


def phrases(words: Sequence[Word], rng: np.random.Generator, count: int) -> Iterator[Phrase]:
    """So many of each command, and of other words half as many as of all commands together, each beside others."""
    others = [word for word in words if _said(word) not in KEYWORDS]
    for keyword in KEYWORDS:
        commands = [word for word in words if _said(word) == keyword]
        yield from (_beside(commands, others, rng) for _ in range(count if commands and others else 0))
    yield from (_beside(others, others, rng) for _ in range(len(KEYWORDS) * count // 2 if others else 0))


def _said(word: Word) -> str:
    return word.word if isinstance(word, Clip) else word.text


def _beside(taught: Sequence[Word], others: Sequence[Word], rng: np.random.Generator) -> Phrase:
    """A word after others, before others, or between."""
    before, after = ((1, 0), (0, 1), (1, 1), (2, 0))[rng.integers(4)]
    first = [_any(others, rng) for _ in range(before)]
    last = [_any(others, rng) for _ in range(after)]
    return Phrase((*first, _any(taught, rng), *last), before)


def _any(words: Sequence[Word], rng: np.random.Generator) -> Word:
    return words[int(rng.integers(len(words)))]


def _sounds(options: argparse.Namespace) -> Iterator[Sound]:
    rng = np.random.default_rng(options.seed)
    texts = [*script(rng, options.scale)]
    yield from texts
    yield from [None] * round(_WITHOUT_SPEECH * options.scale)
    people = [clip for folder in options.words for clip in clips(folder) if belongs(clip.path, folder, "training")]
    yield from people
    single = [text for text in texts if " " not in text.text]
    yield from phrases([*people, *single], rng, round(_PHRASES * options.scale))
    for folder in options.connected:
        yield from (path for path in recordings(folder) if belongs(path, folder, "training"))


if __name__ == "__main__":
    sys.exit(main())
