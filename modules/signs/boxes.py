"""A character of a picture and where it is, as SVHN labels it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from modules.signs.reading import Array


@dataclass(frozen=True, slots=True)
class Box:
    """In pixels; it may reach over the edge of the picture, as some of SVHN's do."""

    label: str
    left: float
    top: float
    width: float
    height: float


def around(boxes: Sequence[Box], sideways: float, upwards: float) -> Array:
    """The corners, clockwise, of the box around all of them, with margins in parts of its height."""
    left, top = min(box.left for box in boxes), min(box.top for box in boxes)
    right, bottom = max(box.left + box.width for box in boxes), max(box.top + box.height for box in boxes)
    beside, above = sideways * (bottom - top), upwards * (bottom - top)
    left, right, top, bottom = left - beside, right + beside, top - above, bottom + above
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]], np.float32)


def square(box: Box, size: float) -> Array:
    """The corners of a square around a character, `size` times as large as its longer side: SVHN's second format."""
    side = max(box.width, box.height) * size / 2
    x, y = box.left + box.width / 2, box.top + box.height / 2
    return np.array(
        [[x - side, y - side], [x + side, y - side], [x + side, y + side], [x - side, y + side]], np.float32
    )
