"""From a picture to the numbers of rooms and houses."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from robotkit import Result, Task, stereo
from robotkit.readings import decoded, picture, taken_at

if TYPE_CHECKING:
    from modules.signs.tracker import Sign
    from modules.signs.watcher import Watcher
    from robotkit import Received
    from robotkit.readings import Image

SMALLEST, LARGEST = 320, 736
"""Longer side, in pixels, of what the detector looks at: at a fifth of full quality or less, and at full quality."""


class Signs(Task):
    """Reads signs; at a lower quality it looks at smaller pictures, so that it keeps up and sees less far."""

    def __init__(self, watcher: Watcher) -> None:
        self._watcher = watcher

    def set_quality(self, quality: float) -> None:
        """Match the work, which grows with the square of the side, to the time that there is."""
        self._watcher.detector.side = round(max(LARGEST * math.sqrt(quality), SMALLEST))

    def process(self, received: Received) -> list[Result]:
        """Give each sign once, with the stamp of the picture in which it was read best."""
        seen, stamp = _seen(received)
        return [Result("sign", _content(sign), sign.stamp) for sign in self._watcher.watch(seen, stamp)]


def _seen(received: Received) -> tuple[Image, int]:
    """The picture of one camera, or the left one of a pair."""
    if received.encoding == "stereo-frame":
        frame = stereo.decode(received.payload)
        return decoded(frame.left, gray=False), taken_at(frame.stamp, received)
    return picture(received)


def _content(sign: Sign) -> dict[str, object]:
    return {
        "text": sign.text,
        "confidence": round(sign.confidence, 3),
        "corners": [[round(float(x), 1), round(float(y), 1)] for x, y in sign.corners],
        "pictures": sign.pictures,
    }
