"""What the digit network learns from: strips cut out of drawn signs, and which digit each of their columns shows."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from modules.signs.boxes import around, square
from modules.signs.digits import HEIGHT, LABELS, NONE, STRIDE, strip
from modules.signs.reading import upright
from modules.signs.rendering import any_conditions, any_number, quad, render

if TYPE_CHECKING:
    from collections.abc import Callable

    from modules.signs.reading import Array
    from modules.signs.rendering import Rendered

FONTS = Path("/usr/share/fonts")
FAMILIES = ("liberation", "lato", "urw-base35", "freefont", "roboto", "open-sans")
"""Folders of the fonts to draw with; none is among those that accuracy is measured with."""
WIDTH = 96
"""Of the strips that it is trained on; a wider one is cut."""
IGNORED = -1
"""The label of a column at which the loss looks away."""

_OTHERS = "ABCDEFGHKMNPRTXYabdehknr-/."
_BATCH = 250


@dataclass(frozen=True)
class Examples:
    """Strips, and the label of each of their columns: a digit, none, or -1 where the loss looks away."""

    strips: Array
    labels: np.ndarray[Any, np.dtype[np.int8]]


def fonts() -> list[str]:
    """The fonts of `FAMILIES` that have digits of the usual form."""
    wanted = (path for path in sorted(FONTS.rglob("*")) if path.suffix in {".ttf", ".otf"})
    found = [str(path) for path in wanted if any(family in str(path) for family in FAMILIES)]
    odd = ("Symbol", "D050000L", "Dingbat", "Z003", "Hairline")
    return [path for path in found if not any(name in path for name in odd)]


def examples(count: int, seed: int, progress: Callable[[int], None]) -> Examples:
    """Draw signs and cut their numbers out, as roughly as a detector does; all cores draw."""
    choice = fonts()
    if not choice:
        raise SystemExit(f"{FONTS} has no font of {', '.join(FAMILIES)}: see docs/measurements/modules.md")
    sizes = [min(_BATCH, count - start) for start in range(0, count, _BATCH)]
    drawn: list[Examples] = []
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:  # XLA's threads do not survive a fork
        for batch in pool.map(draw, sizes, repeat(choice), zip(repeat(seed), range(len(sizes)))):
            drawn.append(batch)
            progress(sum(len(one.strips) for one in drawn))
    return Examples(np.concatenate([one.strips for one in drawn]), np.concatenate([one.labels for one in drawn]))


def draw(count: int, choice: list[str], seed: tuple[int, int]) -> Examples:
    """Some of the signs, in another process; the same whichever process it is."""
    rng = np.random.default_rng(seed)
    strips = np.zeros((count, HEIGHT, WIDTH), np.float32)
    labels = np.full((count, WIDTH // STRIDE), IGNORED, np.int8)
    for index in range(count):
        text = any_number(rng) if rng.random() < 0.85 else _with_letters(rng)
        sign = render(text, str(rng.choice(choice)), any_conditions(rng), rng)
        corners = _corners(sign, rng)
        seen = strip(upright(sign.picture, corners, HEIGHT))[:, :WIDTH]
        strips[index, :, : seen.shape[1]] = seen
        columns = seen.shape[1] // STRIDE
        labels[index, :columns] = column_labels(sign, corners, columns)
    return Examples(strips, labels)


def _with_letters(rng: np.random.Generator) -> str:
    """Letters are not digits; neither is an empty plate."""
    text = [*any_number(rng)[:3], *rng.choice(list(_OTHERS), rng.integers(1, 4))]
    return "".join(rng.permutation(text).tolist()) if rng.random() < 0.5 else "".join(map(str, text))


def _corners(sign: Rendered, rng: np.random.Generator) -> Array:
    """Where the number is: upright in its plane, or a box in the picture, as SVHN's are, or one of its digits."""
    if rng.random() < 0.5:
        corners = quad(sign, rng.uniform(-0.03, 0.6), rng.uniform(-0.04, 0.3))
        return corners.astype(np.float32)
    if rng.random() < 0.4:
        return square(sign.boxes[rng.integers(len(sign.boxes))], rng.uniform(0.95, 1.2))
    return around(sign.boxes, rng.uniform(-0.03, 0.6), rng.uniform(-0.04, 0.3))


def column_labels(sign: Rendered, corners: Array, columns: int) -> np.ndarray[Any, np.dtype[np.int8]]:
    """A column is a digit's when it is in its middle, nobody's when it is between two, and else it does not count."""
    width = columns * STRIDE
    target = np.array([[0, 0], [width, 0], [width, HEIGHT], [0, HEIGHT]], np.float32)
    middles = np.array([[box.left + box.width / 2, box.top + box.height / 2] for box in sign.boxes], np.float32)
    mapped = np.asarray(cv2.perspectiveTransform(middles[None], cv2.getPerspectiveTransform(corners, target)))[0]
    labels = np.full(columns, NONE, np.int8)
    centres = (np.arange(columns) + 0.5) * STRIDE
    for reach, ignore in ((3.6, True), (2.05, False)):
        for box, (x, y) in zip(sign.boxes, mapped, strict=True):
            if box.label in LABELS and 0 <= y <= HEIGHT:
                labels[np.abs(centres - x) <= reach] = IGNORED if ignore else LABELS.index(box.label)
    return labels
