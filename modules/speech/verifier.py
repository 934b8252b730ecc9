"""A second opinion on what the spotter marks: two committees of small networks that see which phones sound there.

One sees a second of sound around the mark, in its own time; the other sees the mark stretched to a fixed width, so that
fast and slow speakers look the same. They err on different sounds.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import BadZipFile

import numpy as np

from modules.speech.phones import PHONES
from modules.speech.spectrum import FRAMES_PER_SECOND

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from modules.speech.spotter import Mark

    Array = NDArray[np.float32]

WEIGHTS = Path(__file__).with_name("weights.npz")

COLUMNS = 25
"""Instants that a network sees, each the mean of some frames."""
INPUTS = COLUMNS * PHONES

_SECOND = 1.0
_WIDENED = 1.5
"""How much wider than the mark the second network looks: what sounds before and after tells words apart."""
_SHORTEST_MARK = 0.2
_SPOTTER_WEIGHT, _SPOTTER_OFFSET = 30.0, 5.5
"""How much the spotter's own score counts, and what is added to make 0 a low threshold: measured, see README.md."""


class WeightsError(Exception):
    """A file that holds no networks; the message names it."""


@dataclass(frozen=True)
class Network:
    """Dense layers with rectifiers between them, and a softmax over the labels at the end."""

    layers: tuple[tuple[Array, Array], ...]

    def log_probabilities(self, views: Array) -> Array:
        """One row for each view: the logarithm of how likely each label is."""
        values = views
        for matrix, bias in self.layers[:-1]:
            values = np.maximum(values @ matrix + bias, 0)
        matrix, bias = self.layers[-1]
        scores = values @ matrix + bias
        scores -= scores.max(axis=1, keepdims=True)
        logarithms: Array = scores - np.log(np.exp(scores).sum(axis=1, keepdims=True))
        return logarithms


@dataclass(frozen=True)
class Verifier:
    """The networks for each of the two views, and the labels that they tell apart."""

    labels: tuple[str, ...]
    committees: tuple[tuple[Network, ...], tuple[Network, ...]]

    def evidence(self, posteriors: Array, mark: Mark) -> float:
        """The log-odds that the mark holds its keyword, with the spotter's own score."""
        seen = views(posteriors, mark.start, mark.end)
        opinions = [
            network.log_probabilities(view[None])[0]
            for committee, view in zip(self.committees, seen, strict=True)
            for network in committee
        ]
        likely = np.exp(np.mean(opinions, axis=0))
        index = self.labels.index(mark.keyword)
        odds = likely[index] / max(float(likely.sum() - likely[index]), 1e-6)
        return float(np.log(odds + 1e-6)) + _SPOTTER_WEIGHT * mark.score + _SPOTTER_OFFSET

    def save(self, path: Path) -> None:
        """Write the weights as 16 bit floats."""
        arrays = {
            f"view{view}.network{number}.{index}.{kind}": array.astype(np.float16)
            for view, committee in enumerate(self.committees)
            for number, network in enumerate(committee)
            for index, layer in enumerate(network.layers)
            for kind, array in zip(("matrix", "bias"), layer, strict=True)
        }
        np.savez_compressed(path, allow_pickle=False, labels=np.array(self.labels), **arrays)

    @classmethod
    def load(cls, path: Path = WEIGHTS) -> Verifier:
        """Read weights that `save` wrote."""
        try:
            with np.load(path, allow_pickle=False) as file:
                first, second = (_committee(file, f"view{view}.") for view in range(2))
                return cls(tuple(map(str, file["labels"])), (first, second))
        except (OSError, ValueError, KeyError, BadZipFile) as error:
            raise WeightsError(f"{path}: not weights that training wrote: {error}") from error


def views(posteriors: Array, start: float, end: float) -> tuple[Array, Array]:
    """A mark from `start` to `end` (in s) as the two networks see it."""
    middle = (start + end) / 2
    half = max(end - start, _SHORTEST_MARK) * _WIDENED / 2
    second = _view(posteriors, middle - _SECOND / 2, middle + _SECOND / 2)
    return second, _view(posteriors, middle - half, middle + half)


def _view(posteriors: Array, start: float, end: float) -> Array:
    """Mean posteriors in columns of equal width; beyond the ends of the stretch nothing sounds.

    The square root makes faint phones visible.
    """
    edges = np.linspace(start * FRAMES_PER_SECOND, end * FRAMES_PER_SECOND, COLUMNS + 1)
    inside = np.clip(edges, 0, len(posteriors))
    whole = np.floor(inside).astype(int)
    padded = np.vstack([posteriors, np.zeros((1, PHONES), np.float32)])
    before = np.vstack([np.zeros((1, PHONES), np.float32), np.cumsum(posteriors, axis=0)])
    sums = before[whole] + (inside - whole)[:, None].astype(np.float32) * padded[whole]
    means = np.diff(sums, axis=0) / np.float32(edges[1] - edges[0])
    seen: Array = np.sqrt(np.maximum(means, 0)).reshape(-1)
    return seen


def _committee(file: Mapping[str, Array], prefix: str) -> tuple[Network, ...]:
    count = len({name.removeprefix(prefix).partition(".")[0] for name in file if name.startswith(prefix)})
    return tuple(_network(file, f"{prefix}network{number}.") for number in range(count))


def _network(file: Mapping[str, Array], prefix: str) -> Network:
    count = sum(name.startswith(prefix) and name.endswith("matrix") for name in file)
    return Network(
        tuple((_float(file, f"{prefix}{i}.matrix"), _float(file, f"{prefix}{i}.bias")) for i in range(count))
    )


def _float(file: Mapping[str, Array], name: str) -> Array:
    return file[name].astype(np.float32)
