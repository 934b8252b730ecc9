"""`python -m modules.signs.training`: draws signs, trains the digit network on them, and writes it as ONNX.

docs/measurements/modules.md says how long it takes and which fonts it draws with. It needs jax and onnx; the module
itself does not.
"""

from __future__ import annotations

import argparse
import sys
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from modules.signs.digits import HEIGHT, LABELS, NONE, WEIGHTS
from modules.signs.examples import IGNORED, examples

if TYPE_CHECKING:
    from collections.abc import Sequence

    from modules.signs.examples import Examples
    from modules.signs.reading import Array

    Parameters = list[tuple[Any, Any]]

_CHANNELS = (1, 12, 24, 40, 64)
_KERNELS = ((3, 3), (3, 3), (3, 3), (HEIGHT // 8, 5))
_POOLS = ((2, 2), (2, 2), (2, 1))
_LAYOUT = ("NHWC", "HWIO", "NHWC")
_BATCH = 64
_LEARNING_RATE = 2e-3


def initial(seed: int) -> Parameters:
    """Random weights (He et al. 2015), for four convolutions and a layer that classifies the labels."""
    rng = np.random.default_rng(seed)
    shapes = [(after, before, *kernel) for (before, after), kernel in zip(pairwise(_CHANNELS), _KERNELS, strict=True)]
    shapes.append((len(LABELS) + 1, _CHANNELS[-1], 1, 1))
    return [
        (jnp.asarray(rng.normal(0, np.sqrt(2 / np.prod(shape[1:])), shape), jnp.float32), jnp.zeros(shape[0]))
        for shape in shapes
    ]


def scores(parameters: Parameters, strips: Any, dropped: Any = None) -> Any:
    """Logits for each column: (pictures, columns, labels). Channels come last: XLA is twice as fast so."""
    values = strips[..., None]
    for index, (weights, bias) in enumerate(parameters):
        tall = index == len(_KERNELS) - 1
        padding = ((0, 0), (2, 2)) if tall else "SAME"
        kernel = jnp.transpose(weights, (2, 3, 1, 0))
        values = jax.lax.conv_general_dilated(values, kernel, (1, 1), padding, dimension_numbers=_LAYOUT) + bias
        if index < len(_KERNELS):
            values = jax.nn.relu(values)
        if index < len(_POOLS):
            count, height, width, channels = values.shape
            down, right = _POOLS[index]
            values = values.reshape(count, height // down, down, width // right, right, channels).max((2, 4))
        if tall and dropped is not None:
            values = values * dropped
    return values[:, 0]


def loss(parameters: Parameters, strips: Any, labels: Any, dropped: Any) -> Any:
    """Cross-entropy over the columns that count; those of nobody count less, as there are more of them."""
    likely = jax.nn.log_softmax(scores(parameters, strips, dropped), axis=2)
    known = jnp.maximum(labels, 0).astype(jnp.int32)
    found = jnp.take_along_axis(likely, known[..., None], axis=2)[..., 0]
    weights = jnp.where(labels == IGNORED, 0, jnp.where(labels == NONE, 0.35, 1.0))
    return -(found * weights).sum() / weights.sum()


@jax.jit
def _step(parameters: Any, moments: Any, batch: Any, rate: Any, count: Any) -> Any:
    """One step of Adam (Kingma and Ba 2015)."""
    value, slopes = jax.value_and_grad(loss)(parameters, *batch)
    first = jax.tree.map(lambda mean, slope: 0.9 * mean + 0.1 * slope, moments[0], slopes)
    second = jax.tree.map(lambda mean, slope: 0.999 * mean + 0.001 * slope**2, moments[1], slopes)
    scale = jnp.sqrt(1 - 0.999**count) / (1 - 0.9**count)
    parameters = jax.tree.map(
        lambda weight, mean, square: weight - rate * scale * mean / (jnp.sqrt(square) + 1e-8), parameters, first, second
    )
    return parameters, (first, second), value


def train(seen: Examples, *, epochs: int, seed: int = 1) -> Parameters:
    """Fit the network; the rate rises for a tenth of the time, then falls to 0 as a cosine."""
    rng = np.random.default_rng(seed)
    parameters: Any = initial(seed)
    moments: Any = (jax.tree.map(jnp.zeros_like, parameters),) * 2
    batches = len(seen.strips) // _BATCH
    for epoch in range(epochs):
        order, total = rng.permutation(len(seen.strips)), 0.0
        for index in range(batches):
            chosen = order[index * _BATCH : (index + 1) * _BATCH]
            done = (epoch + index / batches) / epochs
            rate = _LEARNING_RATE * min(done * 10, 0.5 * (1 + np.cos(np.pi * done)))
            batch = _varied(seen.strips[chosen], rng), seen.labels[chosen], _dropped(rng)
            parameters, moments, value = _step(parameters, moments, batch, rate, epoch * batches + index + 1)
            total += float(value)
        sys.stderr.write(f"epoch {epoch + 1} of {epochs}: loss {total / max(batches, 1):.4f}\n")
    return [(np.asarray(weights), np.asarray(bias)) for weights, bias in parameters]


def _varied(strips: Array, rng: np.random.Generator) -> Array:
    """Each time another: light and dark swapped, contrast, noise."""
    count = len(strips)
    gains = rng.choice([-1, 1], (count, 1, 1)) * rng.uniform(0.7, 1.3, (count, 1, 1))
    noise = rng.normal(0, 1, strips.shape) * rng.uniform(0, 0.15, (count, 1, 1))
    varied: Array = (strips * gains + noise + rng.normal(0, 0.1, (count, 1, 1))).astype(np.float32)
    return varied


def _dropped(rng: np.random.Generator) -> Array:
    kept: Array = (rng.random((_BATCH, 1, 1, _CHANNELS[-1])) < 0.8).astype(np.float32) / np.float32(0.8)
    return kept


def save(parameters: Parameters, path: Path) -> None:
    """Write ONNX; height is fixed, width is free."""
    nodes, constants, name = [], [], "strip"
    for index, (weights, bias) in enumerate(parameters):
        constants += [numpy_helper.from_array(weights, f"w{index}"), numpy_helper.from_array(bias, f"b{index}")]
        tall, wide = weights.shape[2:]
        above = 0 if index == len(_KERNELS) - 1 else tall // 2
        shape = {"kernel_shape": [tall, wide], "pads": [above, wide // 2] * 2}
        nodes.append(_node("Conv", name, f"conv{index}", f"w{index}", f"b{index}", **shape))
        name = f"conv{index}"
        if index < len(_KERNELS):
            nodes.append(_node("Relu", name, f"relu{index}"))
            name = f"relu{index}"
        if index < len(_POOLS):
            size = list(_POOLS[index])
            nodes.append(_node("MaxPool", name, f"pool{index}", kernel_shape=size, strides=size))
            name = f"pool{index}"
    nodes.append(_node("Softmax", name, "columns", axis=1))
    strips = helper.make_tensor_value_info("strip", TensorProto.FLOAT, [1, 1, HEIGHT, "width"])
    columns = helper.make_tensor_value_info("columns", TensorProto.FLOAT, [1, len(LABELS) + 1, 1, "columns"])
    graph = helper.make_graph(nodes, "digits", [strips], [columns], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    onnx.checker.check_model(model)
    onnx.save(model, path)


def _node(kind: str, source: str, target: str, *constants: str, **attributes: Any) -> onnx.NodeProto:
    return helper.make_node(kind, [source, *constants], [target], **attributes)


def main(arguments: Sequence[str] | None = None) -> int:
    """Train and save."""
    parser = argparse.ArgumentParser(prog="python -m modules.signs.training", description=__doc__)
    parser.add_argument("--output", type=Path, default=WEIGHTS)
    parser.add_argument("--signs", type=int, default=16000, help="how many to draw")
    parser.add_argument("--epochs", type=int, default=4)
    parser.add_argument("--seed", type=int, default=7)
    options = parser.parse_args(arguments)

    def progress(done: int) -> None:
        if done % 1000 == 0 or done == options.signs:
            sys.stderr.write(f"{done} of {options.signs} signs\n")

    save(train(examples(options.signs, options.seed, progress), epochs=options.epochs), options.output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
