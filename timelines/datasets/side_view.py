"""What a camera that looks sideways sees: a plastered wall, and now and then the plate of a room on it.

A recording is a folder of JPEG pictures with `data.csv` (seconds, file) and `truth.csv` (from, to, text). Plates slide
through the picture, tilt and blur a little, as they do for a robot that passes; the same view gives the same pictures.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    Image = NDArray[np.uint8]

RATE = 2
"""Pictures a second, unless the view says otherwise: a plate is in view for seconds."""
WIDTH, HEIGHT = 640, 480
PLATE_TEXT = r"[0-9A-Z]{1,6}"
_NOISE = 3.0


@dataclass(frozen=True, slots=True)
class Plate:
    """A sign that is in view from `at` to `until`, in seconds."""

    at: float
    until: float
    text: str


@dataclass(frozen=True, slots=True)
class SideView:
    """What is seen when, in `rate` pictures a second; `seed` makes wall and noise."""

    duration: float
    plates: tuple[Plate, ...]
    seed: int = 7
    rate: float = RATE


def write(folder: Path, view: SideView, progress: Callable[[float], None]) -> None:
    """Write the pictures and both tables into the folder."""
    rng = np.random.default_rng(view.seed)
    wall = _wall(rng)
    times = np.arange(round(view.duration * view.rate)) / view.rate
    (folder / "data").mkdir()
    for index, at in enumerate(times.tolist()):
        noisy = _picture(wall, view, at) + rng.normal(0, _NOISE, (HEIGHT, WIDTH, 3))
        cv2.imwrite(str(folder / "data" / _name(at)), np.clip(noisy, 0, 255).astype(np.uint8))
        progress((index + 1) / len(times))
    _table(folder / "data.csv", ("#at [s]", "filename"), ((f"{at:g}", _name(at)) for at in times.tolist()))
    _table(folder / "truth.csv", ("#from [s]", "to [s]", "text"), ((p.at, p.until, p.text) for p in view.plates))


def _picture(wall: Image, view: SideView, at: float) -> Image:
    picture = wall.copy()
    for plate in view.plates:
        if plate.at <= at < plate.until:
            _hang(picture, plate, (at - plate.at) / (plate.until - plate.at))
    return picture


def _hang(picture: Image, plate: Plate, passed: float) -> None:
    """Draw a plate that has `passed` a part, 0 to 1, of its way through the picture."""
    drawn = _plate(plate.text)
    high, wide = drawn.shape[:2]
    turn = cv2.getRotationMatrix2D((wide / 2, high / 2), 6 * (passed - 0.5), 1.0)
    turn[:, 2] += ((WIDTH - wide) * (0.85 - 0.7 * passed), (HEIGHT - high) * 0.4)
    moved = cv2.warpAffine(drawn, turn, (WIDTH, HEIGHT))
    mask = cv2.warpAffine(np.full((high, wide), 255, np.uint8), turn, (WIDTH, HEIGHT)) > 127
    picture[mask] = cv2.GaussianBlur(moved, (3, 3), 0.8)[mask]


def _plate(text: str) -> Image:
    (wide, high), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, 2.0, 4)
    plate = np.full((high + 60, wide + 60, 3), (240, 242, 240), np.uint8)
    cv2.rectangle(plate, (4, 4), (wide + 55, high + 55), (60, 40, 30), 3)
    cv2.putText(plate, text, (30, high + 30), cv2.FONT_HERSHEY_DUPLEX, 2.0, (40, 30, 30), 4, cv2.LINE_AA)
    return plate


def _wall(rng: np.random.Generator) -> Image:
    coarse = rng.normal(150, 14, (HEIGHT // 24, WIDTH // 24, 1)).astype(np.float32)
    plaster = cv2.resize(coarse, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    return np.clip(np.repeat(plaster[..., None], 3, axis=2), 0, 255).astype(np.uint8)


def _name(at: float) -> str:
    return f"{round(at * 1000):07d}.jpg"


def _table(path: Path, head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(head)
        writer.writerows(rows)
