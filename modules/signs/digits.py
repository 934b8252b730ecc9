"""The paper's own way: a small network that classifies the ten digits as SVHN labels them, one column at a time.

Trained by `training.py`. A text of any width becomes 11 probabilities (0 to 9, and none) for every 4 pixels of it.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from modules.signs.reading import decode

if TYPE_CHECKING:
    from modules.signs.reading import Array, Reading
    from robotkit.readings import Image

WEIGHTS = Path(__file__).with_name("digits.onnx")
LABELS = "0123456789"
NONE = len(LABELS)
HEIGHT = 32
STRIDE = 4
_FAINTEST = 4.0
"""A contrast below this is noise, and is not made any stronger."""


class Digits:
    """Reads digits and nothing else: letters are no digits to it."""

    def __init__(self, weights: Path = WEIGHTS) -> None:
        self._network = cv2.dnn.readNetFromONNX(str(weights))

    def read(self, text: Image) -> Reading:
        """Digits from left to right."""
        return decode(self.columns(strip(text)), LABELS, NONE)

    def columns(self, seen: Array) -> Array:
        """A row of 11 probabilities for each column of a strip."""
        self._network.setInput(seen[None, None])
        columns: Array = np.asarray(self._network.forward(), np.float32)[0, :, 0].T
        return columns


def strip(text: Image) -> Array:
    """What the network sees: gray, 32 pixels high, a width that its stride divides, and always the same contrast."""
    gray = cv2.cvtColor(text, cv2.COLOR_BGR2GRAY) if text.ndim == 3 else text
    width = max(round(gray.shape[1] * HEIGHT / gray.shape[0] / STRIDE), HEIGHT // STRIDE // 2) * STRIDE
    sized = np.asarray(cv2.resize(gray, (width, HEIGHT), interpolation=cv2.INTER_AREA), np.float32)
    seen: Array = (sized - sized.mean()) / max(float(sized.std()), _FAINTEST)
    return seen
