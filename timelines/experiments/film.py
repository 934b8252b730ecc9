"""`python -m timelines.experiments.film`: keep some of the camera's frames of the first held-out story with the data.

The report draws them below the contexts, as the paper's Figure 5c does; recordings are not committed.
"""

from __future__ import annotations

import cv2
import numpy as np

from timelines.datasets.recordings import ROOT
from timelines.experiments.__main__ import DATA
from timelines.experiments.evidence import film_file
from timelines.experiments.stories import HELD_OUT

FRAMES = 10
WIDTH = 120
"""Pixels of a frame."""


def main() -> None:
    """Write the strip: so many frames, each from the middle of its part of the story."""
    story = HELD_OUT[0].name
    every = sorted((ROOT / story / "mav0" / "cam0" / "data").glob("*.png"))
    if not every:
        raise SystemExit(f"{ROOT / story}: no frames: run `make recordings` first")
    chosen = [every[len(every) * (2 * number + 1) // (2 * FRAMES)] for number in range(FRAMES)]
    path = film_file(DATA, story)
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.hstack([_small(str(one)) for one in chosen]))


def _small(path: str) -> np.ndarray:
    frame = cv2.imread(path, cv2.IMREAD_GRAYSCALE)
    if frame is None:
        raise SystemExit(f"{path}: not a picture: delete the folder and run `make recordings` again")
    height, width = frame.shape[:2]
    return cv2.resize(frame, (WIDTH, WIDTH * height // width), interpolation=cv2.INTER_AREA)


if __name__ == "__main__":
    main()
