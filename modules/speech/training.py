"""`python -m modules.speech.training`: synthesises speech, trains the verifier's networks on it, writes their weights.

README.md says how long it takes, on one core, and which of Debian's packages speak.
"""

from __future__ import annotations

import argparse
import sys
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from modules.speech.corpus import script
from modules.speech.examples import LABELS, examine
from modules.speech.verifier import INPUTS, WEIGHTS, Network, Verifier

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from modules.speech.corpus import Spoken
    from modules.speech.examples import Examples, Labels
    from modules.speech.verifier import Array

    Layers = list[list[Array]]

_COMMITTEE = 3
"""Networks for each view: their mean errs less on voices that none of them knows."""
_UNMARKED = 0.1
"""How much of the weight of what is no command goes to stretches that the spotter would not mark."""
_WITHOUT_SPEECH = 300
"""Sounds in which nobody speaks, at scale 1."""
_HIDDEN = 96
_EPOCHS = 12
_LEARNING_RATE = 1e-3
_DECAY = 1e-4
_DROPOUT = 0.25
_BATCH = 128


def train(examples: Examples, *, epochs: int = _EPOCHS, committee: int = _COMMITTEE) -> Verifier:
    """Fit networks to each view, which differ by their first weights and by the order of what they see."""
    weights = importance(examples.labels, examples.marked)
    first, second = (
        tuple(fit(seen, examples.labels, weights, epochs=epochs, seed=seed) for seed in range(committee))
        for seen in examples.views
    )
    return Verifier(LABELS, (first, second))


def importance(labels: Labels, marked: NDArray[np.bool_]) -> Array:
    """What each example counts: all commands alike, together as much as all else; the mean is 1."""
    groups = np.where(
        labels > 0, labels + 1, marked
    )  # 0 and 1 are no commands: those that are not marked, and those that are
    counts = np.bincount(groups, minlength=len(LABELS) + 1)
    parts = 0.5 * np.array([_UNMARKED, 1 - _UNMARKED, *[1 / (len(LABELS) - 1)] * (len(LABELS) - 1)])
    weights: Array = (parts * len(labels) / np.maximum(counts, 1))[groups].astype(np.float32)
    return weights


def fit(seen: Array, labels: Labels, weights: Array, *, epochs: int, seed: int = 1) -> Network:
    """Minimise the cross-entropy with Adam (Kingma and Ba 2015), dropout, and a rate that falls to 0 as a cosine."""
    rng = np.random.default_rng(seed)
    layers: Layers = [
        [rng.normal(0, np.sqrt(2 / rows), (rows, columns)).astype(np.float32), np.zeros(columns, np.float32)]
        for rows, columns in pairwise((INPUTS, _HIDDEN, len(LABELS)))
    ]
    adam = _Adam([array for layer in layers for array in layer])
    for epoch in range(epochs):
        rate = _LEARNING_RATE * 0.5 * (1 + np.cos(np.pi * epoch / epochs))
        for chosen in np.array_split(rng.permutation(len(labels)), -(-len(labels) // _BATCH)):
            truth = labels[chosen]
            adam.step(_gradients(layers, seen[chosen], truth, weights[chosen], rng), rate)
    return Network(tuple((matrix, bias) for matrix, bias in layers))


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
    texts: list[Spoken | None] = [*script(np.random.default_rng(options.seed), options.scale)]
    texts += [None] * round(_WITHOUT_SPEECH * options.scale)

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
