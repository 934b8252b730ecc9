"""SVHN's two published formats (Netzer et al., "Reading Digits in Natural Images", 2011), read and written.

Format 1: pictures `1.png`, ... beside `digitStruct.mat` (MATLAB 7.3, so HDF5): the box and label of each digit.
Format 2: `test_32x32.mat` (MATLAB 5): pictures of 32 x 32 around one digit; what is beside it may be seen too.
In both, the label of the digit 0 is 10.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import h5py
import numpy as np
import scipy.io

from modules.signs.boxes import Box
from robotkit import ConfigurationError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from robotkit.readings import Image

SIDE = 32
FIELDS = ("left", "top", "width", "height", "label")
_TEN = 10
_USER_BLOCK = 512
"""Bytes before the HDF5 part of a MATLAB 7.3 file: text, then the version and the byte order."""


class SvhnError(ConfigurationError):
    """A file that is not what its format promises; the message names it, and what is wrong."""


@dataclass(frozen=True, slots=True)
class Number:
    """A picture of format 1, by path, and the digits in it from left to right."""

    path: Path
    boxes: tuple[Box, ...]

    @property
    def text(self) -> str:
        """The whole number."""
        return "".join(box.label for box in self.boxes)

    def picture(self) -> Image:
        """The picture (BGR)."""
        picture = cv2.imread(str(self.path), cv2.IMREAD_COLOR_BGR)
        if picture is None:
            raise SvhnError(f"{self.path}: not a picture")
        return picture.astype(np.uint8, copy=False)


def numbers(path: Path) -> Iterator[Number]:
    """Format 1, from its digitStruct.mat, one number at a time: the largest set has 200,000."""
    try:
        with h5py.File(path) as file:
            names, boxes = file["digitStruct/name"], file["digitStruct/bbox"]
            if len(names) != len(boxes):
                raise SvhnError(f"{path}: {len(names)} names and {len(boxes)} boxes")
            for index in range(len(names)):
                try:
                    name = _text(file[names[index][0]][()])
                    found = tuple(_boxes(file, file[boxes[index][0]]))
                except (KeyError, ValueError, TypeError, IndexError, AttributeError) as error:
                    raise SvhnError(f"{path}: entry {index + 1}: {_said(error)}") from error
                yield Number(path.parent / name, tuple(sorted(found, key=lambda box: box.left)))
    except (OSError, KeyError, TypeError, AttributeError, RuntimeError) as error:
        raise SvhnError(f"{path}: not SVHN's digitStruct.mat (MATLAB 7.3): {_said(error)}") from error


def digits(path: Path) -> tuple[Image, list[str]]:
    """Format 2: pictures (count, 32, 32, 3; BGR) and the digit in the middle of each."""
    try:
        content = scipy.io.loadmat(path, variable_names=("X", "y"))
        pictures, labels = content["X"], content["y"].ravel()
    except Exception as error:  # a damaged file raises all kinds of errors in SciPy
        raise SvhnError(f"{path}: not SVHN's format 2 (MATLAB 5, with X and y): {_said(error)}") from error
    if pictures.dtype != np.uint8 or pictures.ndim != 4 or pictures.shape[:3] != (SIDE, SIDE, 3):
        raise SvhnError(f"{path}: X is {pictures.dtype} {pictures.shape}: expected uint8 (32, 32, 3, count)")
    if len(labels) != pictures.shape[3]:
        raise SvhnError(f"{path}: {pictures.shape[3]} pictures and {len(labels)} labels")
    try:
        parsed = [_label(float(label)) for label in labels]
    except (ValueError, TypeError) as error:
        raise SvhnError(f"{path}: y: {error}") from error
    return np.ascontiguousarray(pictures.transpose(3, 0, 1, 2)[..., ::-1]), parsed


def write_numbers(folder: Path, pictures: Sequence[tuple[Image, Sequence[Box]]]) -> Path:
    """Write format 1; returns the path of its digitStruct.mat."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "digitStruct.mat"
    with h5py.File(path, "w", userblock_size=_USER_BLOCK) as file:
        group, stored = file.create_group("digitStruct"), file.create_group("#refs#")
        names, boxes = (group.create_dataset(name, (len(pictures), 1), h5py.ref_dtype) for name in ("name", "bbox"))
        for index, (picture, found) in enumerate(pictures):
            name = f"{index + 1}.png"
            cv2.imwrite(str(folder / name), picture)
            codes = np.array([[ord(letter)] for letter in name], np.uint16)
            names[index, 0] = stored.create_dataset(f"n{index}", data=codes).ref
            boxes[index, 0] = _store_boxes(stored, f"b{index}", found).ref
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    return path


def write_digits(path: Path, pictures: Image, labels: Sequence[str]) -> None:
    """Write format 2."""
    values = np.array([[int(label) or _TEN] for label in labels], np.uint8)
    scipy.io.savemat(path, {"X": pictures[..., ::-1].transpose(1, 2, 3, 0), "y": values}, do_compression=True)


def _store_boxes(stored: Any, name: str, boxes: Sequence[Box]) -> Any:
    """As MATLAB does: the number itself for a single digit, else references to one number each."""
    group = stored.create_group(name)
    for field in FIELDS:
        values = [float(int(box.label) or _TEN) if field == "label" else getattr(box, field) for box in boxes]
        if len(values) == 1:
            group.create_dataset(field, data=np.array([values], np.float64))
            continue
        references = group.create_dataset(field, (len(values), 1), h5py.ref_dtype)
        for index, value in enumerate(values):
            single = stored.create_dataset(f"{name}{field}{index}", data=np.array([[value]], np.float64))
            references[index, 0] = single.ref
    return group


def _boxes(file: Any, group: Any) -> Iterator[Box]:
    columns = [_values(file, group[field]) for field in FIELDS]
    for left, top, width, height, label in zip(*columns, strict=True):
        if not all(map(math.isfinite, (left, top, width, height))) or width <= 0 or height <= 0:
            raise ValueError(f"a box of {width:g} x {height:g} at {left:g}, {top:g}")
        yield Box(_label(label), left, top, width, height)


def _values(file: Any, field: Any) -> list[float]:
    if h5py.check_ref_dtype(field.dtype) is None:
        return [float(field[0][0])]
    return [float(file[reference][0][0]) for reference in field[:, 0]]


def _label(value: float) -> str:
    if value != int(value) or not 1 <= value <= _TEN:
        raise ValueError(f"label: invalid value {value:g}: expected 1 to 10, where 10 is the digit 0")
    return str(int(value) % _TEN)


def _text(codes: Any) -> str:
    name = "".join(chr(code) for code in np.asarray(codes).ravel())
    if "/" in name or not name.isprintable():
        raise ValueError(f"{name!r} is not a file of this folder")
    return name


def _said(error: Exception) -> str:
    return f"{error}" or repr(error)
