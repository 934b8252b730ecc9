"""PP-OCR's recognition network, kept to what numbers are made of."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from modules.signs.reading import Reading, decode

if TYPE_CHECKING:
    from collections.abc import Sequence

    from robotkit.readings import Image

HEIGHT = 48
SIGNS = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz-./"
"""What room and house numbers are written with."""
_BLANK = 0
_MULTIPLE = 32


class Paddle:
    """Reads lines of text; of the 18,000 characters that it supports, only those of `SIGNS` are reported."""

    def __init__(self, network: cv2.dnn.Net, characters: Sequence[str]) -> None:
        known = ["", *characters]
        self._network = network
        self._columns = [_BLANK, *(known.index(sign) for sign in SIGNS)]
        self._labels = ["", *SIGNS]

    def read(self, text: Image) -> Reading:
        """All characters that numbers are made of; where another one is likelier, their confidence is low."""
        width = max(round(text.shape[1] * HEIGHT / text.shape[0]), 1)
        sized = cv2.resize(text, (width, HEIGHT))
        right = -width % _MULTIPLE
        padded = cv2.copyMakeBorder(sized, 0, 0, 0, right, cv2.BORDER_CONSTANT, value=(127, 127, 127))
        self._network.setInput(cv2.dnn.blobFromImage(padded, 1 / 127.5, (width + right, HEIGHT), (127.5, 127.5, 127.5)))
        likely = np.asarray(self._network.forward(), np.float32)[0]
        return decode(likely[:, self._columns], self._labels, _BLANK).stretched((width + right) / width)
