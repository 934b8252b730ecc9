"""From pictures to signs: find texts, cut them out upright, read those that are not known yet."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from modules.signs.paddle import HEIGHT
from modules.signs.reading import upright
from modules.signs.tracker import Tracker

if TYPE_CHECKING:
    from modules.signs.detector import Detector
    from modules.signs.reading import Array, Reader
    from modules.signs.tracker import Sign
    from robotkit.readings import Image

LOOK_NS = 5_000_000_000
"""Even where nothing seems to change, it looks so often."""
_CELLS = (94, 60)
_CHANGE = 6.0
"""Brightness, of 255, by which one of the cells of a picture changes when something moves."""


class Watcher:
    """Looks at pictures in the order of their stamps (ns); one that shows the same as the last costs nearly nothing."""

    def __init__(self, detector: Detector, reader: Reader) -> None:
        self.detector = detector
        self._reader = reader
        self._tracker = Tracker()
        self._last: tuple[int, Array] | None = None

    def watch(self, picture: Image, stamp: int) -> list[Sign]:
        """The signs to report now: read with confidence, or gone."""
        if self._is_the_same(picture, stamp) and self._tracker.is_settled:
            self._tracker.linger(stamp)
            return []
        self._last = stamp, _coarse(picture)
        texts = self.detector.find(picture)
        return self._tracker.follow(texts, stamp, lambda text: self._reader.read(upright(picture, text, HEIGHT)))

    def _is_the_same(self, picture: Image, stamp: int) -> bool:
        if self._last is None or not 0 <= stamp - self._last[0] < LOOK_NS:
            return False
        return float(np.abs(_coarse(picture) - self._last[1]).max()) < _CHANGE


def _coarse(picture: Image) -> Array:
    gray = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    return np.asarray(cv2.resize(gray, _CELLS, interpolation=cv2.INTER_AREA), np.float32)
