"""Which command, if any, a second of sound holds: small networks of convolutions along time, in numpy."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import BadZipFile

import numpy as np

from modules.speech.windows import centred

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    Array = NDArray[np.float32]

WEIGHTS = Path(__file__).with_name("weights.npz")
_FEW = 1e-7


class WeightsError(Exception):
    """A file that holds no networks; the message names it."""


@dataclass(frozen=True, eq=False)
class Layer:
    """A convolution: `matrix` is (width, inputs, outputs); it moves by `stride` columns."""

    matrix: Array
    bias: Array
    stride: int

    def stretches(self, values: Array) -> Array:
        """What it sees at each of its places, a row each: (windows, places, width * inputs)."""
        width, inputs, _ = self.matrix.shape
        seen = np.lib.stride_tricks.sliding_window_view(values, width, axis=1)[:, :: self.stride]
        return np.ascontiguousarray(seen.transpose(0, 1, 3, 2)).reshape(*seen.shape[:2], width * inputs)

    def __call__(self, values: Array) -> Array:
        """Take (windows, columns, inputs), give (windows, places, outputs)."""
        found: Array = self.stretches(values) @ self.matrix.reshape(-1, self.matrix.shape[2]) + self.bias
        return found


@dataclass(frozen=True, eq=False)
class Network:
    """Layers with rectifiers between them, the last of which has one place, and a softmax over the labels."""

    layers: tuple[Layer, ...]

    def log_probabilities(self, windows: Array) -> Array:
        """One row for each window: the logarithm of how likely each label is."""
        values = centred(windows)
        for layer in self.layers[:-1]:
            values = np.maximum(layer(values), 0)
        scores = self.layers[-1](values)[:, 0]
        scores -= scores.max(axis=1, keepdims=True)
        logarithms: Array = scores - np.log(np.exp(scores).sum(axis=1, keepdims=True))
        return logarithms


@dataclass(frozen=True)
class Committee:
    """Networks that differ by chance; their mean errs less on voices that none of them knows."""

    labels: tuple[str, ...]
    """The first is that of everything else."""
    networks: tuple[Network, ...]

    def evidence(self, windows: Array) -> Array:
        """The log-odds that a window holds each of the commands: (windows, labels but the first)."""
        likely = np.exp(np.mean([network.log_probabilities(windows) for network in self.networks], axis=0))
        likely = likely[:, 1:] / likely.sum(axis=1, keepdims=True)
        odds: Array = np.log(likely + _FEW) - np.log(1 - likely + _FEW)
        return odds

    def save(self, path: Path) -> None:
        """Write the weights as 16 bit floats."""
        arrays: dict[str, NDArray[np.generic]] = {"labels": np.array(self.labels)}
        for number, network in enumerate(self.networks):
            for index, layer in enumerate(network.layers):
                arrays[f"network{number}.{index}.matrix"] = layer.matrix.astype(np.float16)
                arrays[f"network{number}.{index}.bias"] = layer.bias.astype(np.float16)
                arrays[f"network{number}.{index}.stride"] = np.array(layer.stride)
        np.savez_compressed(path, allow_pickle=False, **arrays)

    @classmethod
    def load(cls, path: Path = WEIGHTS) -> Committee:
        """Read weights that `save` wrote."""
        try:
            with np.load(path, allow_pickle=False) as file:
                count = len({name.partition(".")[0] for name in file if name != "labels"})
                networks = tuple(_network(file, f"network{number}.") for number in range(count))
                return cls(tuple(map(str, file["labels"])), networks)
        except (OSError, ValueError, KeyError, BadZipFile) as error:
            raise WeightsError(f"{path}: not weights that training wrote: {error}") from error


def _network(file: Mapping[str, Array], prefix: str) -> Network:
    count = sum(name.startswith(prefix) and name.endswith("matrix") for name in file)
    return Network(tuple(_layer(file, f"{prefix}{index}.") for index in range(count)))


def _layer(file: Mapping[str, Array], prefix: str) -> Layer:
    matrix, bias = (file[f"{prefix}{kind}"].astype(np.float32) for kind in ("matrix", "bias"))
    return Layer(matrix, bias, int(file[f"{prefix}stride"]))
