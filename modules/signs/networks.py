"""The PP-OCR networks, as the Python package rapidocr brings them: nothing is downloaded, and none of its code runs."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import cv2

from robotkit import ConfigurationError

if TYPE_CHECKING:
    from collections.abc import Iterator

DETECTION, RECOGNITION = "PP-OCRv6_det_small.onnx", "PP-OCRv6_rec_small.onnx"

_METADATA = 14
"""Number of ModelProto's field metadata_props in ONNX; its entries have a key in field 1 and a value in field 2."""
_LENGTH_DELIMITED = 2


@dataclass(frozen=True)
class Networks:
    """The folder of both networks."""

    folder: Path

    def detection(self) -> cv2.dnn.Net:
        """A picture in, how likely each pixel is a text's out."""
        return self._load(DETECTION)

    def recognition(self) -> tuple[cv2.dnn.Net, list[str]]:
        """A text in, columns of probabilities out; and the characters that they are of, from the second one on."""
        network = self._load(RECOGNITION)
        characters = metadata(self.folder / RECOGNITION).get("character", "").split("\n")
        return network, characters

    def _load(self, name: str) -> cv2.dnn.Net:
        path = self.folder / name
        if not path.is_file():
            raise ConfigurationError(f"{path} is missing: SIGNS_MODELS names the folder of {DETECTION}, {RECOGNITION}")
        try:
            return cv2.dnn.readNetFromONNX(str(path))
        except cv2.error as error:
            raise ConfigurationError(f"{path} is not a network that OpenCV can read: {error.err}") from error


def find(folder: str) -> Networks:
    """The networks in a folder, or those of the installed package."""
    if folder:
        return Networks(Path(folder))
    package = find_spec("rapidocr")
    if package is None or package.origin is None:
        raise ConfigurationError("rapidocr is not installed (pip install --no-deps --requirement models.txt)")
    return Networks(Path(package.origin).parent / "models")


def metadata(path: Path) -> dict[str, str]:
    """The metadata of an ONNX file."""
    content = memoryview(path.read_bytes())
    try:
        entries = [dict(_fields(value)) for number, value in _fields(content) if number == _METADATA]
        return {bytes(entry[1]).decode(): bytes(entry[2]).decode() for entry in entries}
    except (IndexError, KeyError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path} does not list the characters that it reads: {error!r}") from error


def _fields(message: memoryview) -> Iterator[tuple[int, memoryview]]:
    """Number and content of a message's length-delimited fields (Protocol Buffers, "Encoding")."""
    at = 0
    while at < len(message):
        tag, at = _varint(message, at)
        value, at = _varint(message, at)
        if tag & 7 == _LENGTH_DELIMITED:
            if at + value > len(message):
                raise IndexError("it ends within a field")
            yield tag >> 3, message[at : at + value]
            at += value


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = message[at]
        value |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if byte < 0x80:
            return value, at
