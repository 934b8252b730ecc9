"""Pictures of signs for training and measuring: plates on walls, seen from a distance, at an angle, in bad light.

The box of every character is known, as SVHN's are.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import matplotlib as mpl
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from modules.signs.boxes import Box, around

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Pixels = NDArray[np.uint8]

FOCAL = 458.0
"""Of the robot's cameras, in pixels."""
JPEG_QUALITY = 80
_DETAIL = 2
"""Plates are drawn so much larger than they are seen, so that edges are smooth."""
_LETTERS = Path(mpl.get_data_path()) / "fonts/ttf"
TEST_FONTS = tuple(
    str(_LETTERS / f"{name}.ttf")
    for name in (
        *("DejaVuSans", "DejaVuSans-Bold", "DejaVuSans-Oblique", "DejaVuSansMono", "DejaVuSansMono-Bold"),
        *("DejaVuSerif", "DejaVuSerif-Bold", "STIXGeneral", "STIXGeneralBol", "cmr10", "cmss10", "cmtt10"),
    )
)
"""Fonts to measure with: they come with matplotlib, and no network was trained on them."""


@dataclass(frozen=True, slots=True)
class Conditions:
    """How a sign is seen: `height` of its digits and both blurs in pixels, angles in degrees, `light` 1 is daylight."""

    height: float = 30
    tilt: float = 0
    pitch: float = 0
    roll: float = 0
    blur: float = 0.5
    motion: float = 0
    light: float = 1


@dataclass(frozen=True)
class Rendered:
    """A picture (BGR), its characters from left to right, and how the plate's plane was projected into it."""

    picture: Pixels
    boxes: tuple[Box, ...]
    plate: tuple[Box, ...]
    homography: Array

    @property
    def text(self) -> str:
        """The text of the sign."""
        return "".join(box.label for box in self.boxes)


@dataclass(frozen=True)
class _Plate:
    pixels: Pixels
    boxes: tuple[Box, ...]


def render(  # noqa: PLR0913 - what, how, and where
    text: str,
    font: str,
    conditions: Conditions,
    rng: np.random.Generator,
    *,
    size: tuple[int, int] | None = None,
    middle: tuple[float, float] | None = None,
) -> Rendered:
    """Draw a sign with its `middle` somewhere in a picture of `size` (width, height), or in one that fits the sign."""
    plate = _plate(text, font, conditions.height, rng)
    homography, extent = _projection(plate, conditions)
    if size is None:
        margins = rng.uniform(0.05, 0.7, 4) * conditions.height
        size = (round(extent[0] + margins[0] + margins[1]), round(extent[1] + margins[2] + margins[3]))
        middle = (extent[0] / 2 + margins[0], extent[1] / 2 + margins[2])
    if middle is None:
        middle = (size[0] / 2, size[1] / 2)
    homography = _shift(*middle) @ homography
    wall = _wall(size, rng)
    seen = cv2.warpPerspective(plate.pixels, homography, size, flags=cv2.INTER_AREA)
    covered = cv2.warpPerspective(np.full(plate.pixels.shape[:2], 255, np.uint8), homography, size)[..., None] / 255
    scene = np.asarray(seen, np.float64) * covered + wall * (1 - covered)
    boxes = tuple(_projected(box, homography) for box in plate.boxes)
    return Rendered(_camera(scene, conditions, rng), boxes, plate.boxes, homography)


def any_number(rng: np.random.Generator) -> str:
    """A room or house number of one to five digits, most of them of two to four."""
    digits = int(rng.choice([1, 2, 3, 4, 5], p=[0.1, 0.25, 0.4, 0.2, 0.05]))
    return "".join([str(rng.integers(1, 10)), *map(str, rng.integers(0, 10, digits - 1))])


def any_conditions(rng: np.random.Generator) -> Conditions:
    """Whatever a robot may see that a person could still read."""
    height = float(np.exp(rng.uniform(np.log(9), np.log(60))))
    blur = rng.uniform(0.3, 0.075 * height)
    return Conditions(
        height=height,
        tilt=rng.normal(0, 25),
        pitch=rng.normal(0, 8),
        roll=rng.normal(0, 5),
        blur=blur,
        motion=rng.uniform(0, 0.2 * height) if rng.random() < 0.3 else 0,
        light=float(np.exp(rng.uniform(np.log(0.1), np.log(1.2)))),
    )


def _frontal(rng: np.random.Generator) -> Conditions:
    return Conditions(height=rng.uniform(20, 50))


def _blurred(rng: np.random.Generator) -> Conditions:
    height = rng.uniform(20, 50)
    return Conditions(height=height, blur=0.08 * height, motion=rng.uniform(0, 0.25) * height)


def _tilted(rng: np.random.Generator) -> Conditions:
    tilt = rng.uniform(40, 60) * rng.choice([-1, 1])
    return Conditions(height=rng.uniform(20, 50), tilt=tilt, pitch=rng.normal(0, 8), roll=rng.normal(0, 5))


def _dark(rng: np.random.Generator) -> Conditions:
    return Conditions(height=rng.uniform(20, 50), light=rng.uniform(0.08, 0.2))


def _far(rng: np.random.Generator) -> Conditions:
    """Digits of 6 cm at 2.5 to 3 m."""
    return Conditions(height=FOCAL * 0.06 / rng.uniform(2.5, 3))


SETS: dict[str, Callable[[np.random.Generator], Conditions]] = {
    "frontal": _frontal,
    "blur": _blurred,
    "tilt": _tilted,
    "dark": _dark,
    "far": _far,
    "all at once": any_conditions,
}
"""What accuracy is measured in."""


@cache
def _font(path: str, size: int) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(path, size)


def _plate(text: str, path: str, height: float, rng: np.random.Generator) -> _Plate:
    """Draw the text on a plate with a margin, maybe a frame, in two colours that differ."""
    digit = max(round(height * _DETAIL), 12)
    font = _font(path, round(digit / 0.72))
    spacing = rng.uniform(-0.02, 0.22) * digit
    margin = rng.uniform(0.2, 0.9, 2) * digit
    placed, x = [], float(margin[0])
    for label in text:
        left, top, right, bottom = font.getbbox(label, anchor="ls")
        placed.append((label, x - left, Box(label, x, margin[1] + digit + top, right - left, bottom - top)))
        x += right - left + max(spacing, 0.04 * digit)
    size = round(x + margin[0]), round(digit + 2 * margin[1])
    paper, ink = _colours(rng)
    image = Image.new("RGB", size, paper)
    draw = ImageDraw.Draw(image)
    if rng.random() < 0.3:
        inset = 0.12 * digit
        frame = (inset, inset, size[0] - inset, size[1] - inset)
        draw.rectangle(frame, outline=ink, width=max(digit // 16, 1))
    for label, begin, _ in placed:
        draw.text((begin, margin[1] + digit), label, fill=ink, font=font, anchor="ls")
    return _Plate(np.asarray(image, np.uint8), tuple(box for _, _, box in placed))


def _colours(rng: np.random.Generator) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Paper and ink that differ by at least a fifth of the range in brightness; either may be the darker."""
    while True:
        gray = rng.random() < 0.4
        first, second = (np.full(3, rng.uniform(0, 255)) if gray else rng.uniform(0, 255, 3) for _ in range(2))
        if abs(first.mean() - second.mean()) > rng.uniform(50, 140):
            return tuple(first.astype(int).tolist()), tuple(second.astype(int).tolist())


def _projection(plate: _Plate, conditions: Conditions) -> tuple[Array, Array]:
    """A homography of the plate around (0, 0), and the size of what it covers."""
    height, width = plate.pixels.shape[:2]
    yaw, pitch, roll = np.radians([conditions.tilt, conditions.pitch, conditions.roll])
    turn = _turn(yaw, 1) @ _turn(pitch, 0) @ _turn(roll, 2)
    distance = FOCAL * _DETAIL  # in pixels of the plate, one of which is 1/_DETAIL pixels of the picture there
    inside = np.column_stack([turn[:, 0], turn[:, 1], [0, 0, distance]])
    homography = np.diag([FOCAL, FOCAL, 1]) @ inside @ _shift(-width / 2, -height / 2)
    corners = _map(homography, np.array([[0, 0], [width, 0], [width, height], [0, height]], float))
    return homography, np.ptp(corners, axis=0)


def _turn(angle: float, axis: int) -> Array:
    cos, sin = np.cos(angle), np.sin(angle)
    matrix = np.eye(3)
    first, second = [index for index in range(3) if index != axis]
    matrix[first, first] = matrix[second, second] = cos
    matrix[first, second], matrix[second, first] = -sin, sin
    return matrix


def _shift(x: float, y: float) -> Array:
    return np.array([[1, 0, x], [0, 1, y], [0, 0, 1]], float)


def _map(homography: Array, points: Array) -> Array:
    mapped = np.column_stack([points, np.ones(len(points))]) @ homography.T
    result: Array = mapped[:, :2] / mapped[:, 2:]
    return result


def quad(rendered: Rendered, sideways: float, upwards: float) -> Array:
    """The corners of the text in the picture, clockwise, with margins in parts of its height."""
    return _map(rendered.homography, around(rendered.plate, sideways, upwards).astype(np.float64))


def _projected(box: Box, homography: Array) -> Box:
    right, bottom = box.left + box.width, box.top + box.height
    corners = np.array([[box.left, box.top], [right, box.top], [right, bottom], [box.left, bottom]])
    mapped = _map(homography, corners)
    (left, top), (width, height) = mapped.min(axis=0), np.ptp(mapped, axis=0)
    return Box(box.label, float(left), float(top), float(width), float(height))


def _wall(size: tuple[int, int], rng: np.random.Generator) -> Array:
    """A wall: a colour, slow shades, edges of doors and cupboards, and grain."""
    width, height = size
    wall = np.full((height, width, 3), rng.uniform(20, 235, 3))
    for _ in range(rng.integers(0, 6)):
        x, y = rng.integers(-width // 4, width), rng.integers(-height // 4, height)
        colour = tuple(map(float, rng.uniform(10, 245, 3)))
        far = int(x + rng.integers(1, width + 1)), int(y + rng.integers(1, height + 1))
        cv2.rectangle(wall, (int(x), int(y)), far, colour, int(rng.choice([-1, 1, 2])))
    shades = cv2.resize(rng.normal(0, 12, (3, 4, 3)), size, interpolation=cv2.INTER_CUBIC)
    return wall + np.asarray(shades, np.float64) + rng.normal(0, 3, wall.shape)


def _camera(scene: Array, conditions: Conditions, rng: np.random.Generator) -> Pixels:
    """Expose: blur, a gradient of light, noise that is stronger where light is scarce, 8 bits, JPEG."""
    height, width = scene.shape[:2]
    if conditions.motion >= 1:
        kernel = np.zeros((1, round(conditions.motion) + 1))
        kernel[:] = 1 / kernel.size
        scene = np.asarray(cv2.filter2D(scene, -1, kernel), np.float64)
    scene = np.asarray(cv2.GaussianBlur(scene, (0, 0), max(conditions.blur, 0.05)), np.float64)
    slope = 1 + rng.uniform(-0.35, 0.35) * np.linspace(-1, 1, width)[None, :, None]
    light = scene * slope * conditions.light
    noise = rng.normal(0, 1, scene.shape) * np.sqrt(1.5 + 0.05 * np.maximum(light, 0))
    exposed = np.clip(light + noise, 0, 255).astype(np.uint8)
    encoded = cv2.imencode(".jpg", exposed, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
    picture = cv2.imdecode(encoded, cv2.IMREAD_COLOR)
    assert picture is not None, (width, height)  # noqa: S101 - it was encoded just now
    return np.asarray(picture, np.uint8)
